"""Segmentors."""

from rm3d_plugin.models.segmentors.point_inputs import PointInputs, point_inputs
from rm3d_plugin.models.segmentors.rm3d_segmentor import RM3DSegmentor, segmentation_losses

__all__ = ['PointInputs', 'RM3DSegmentor', 'point_inputs', 'segmentation_losses']
