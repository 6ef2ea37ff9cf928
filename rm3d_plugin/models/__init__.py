"""Networks, heads and losses: everything that learns from labels."""

from rm3d_plugin.models import backbones, detectors, heads, losses, segmentors
from rm3d_plugin.models.preprocessor import ScenePreprocessor, join_scenes

__all__ = ['ScenePreprocessor', 'backbones', 'detectors', 'heads', 'join_scenes', 'losses', 'segmentors']
