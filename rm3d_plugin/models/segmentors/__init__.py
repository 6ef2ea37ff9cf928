"""Segmentors."""

from rm3d_plugin.models.segmentors.point_inputs import PointInputs, point_inputs
from rm3d_plugin.models.segmentors.rm3d_segmentor import RM3DSegmentor, SegmentorOutput

__all__ = ['PointInputs', 'RM3DSegmentor', 'SegmentorOutput', 'point_inputs']
