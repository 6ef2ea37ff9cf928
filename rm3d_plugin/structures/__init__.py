"""Frozen, checked containers."""

from rm3d_plugin.structures.boxes3d import Boxes3D, box_rows
from rm3d_plugin.structures.descriptors import Descriptors
from rm3d_plugin.structures.label_statistics import LabelStatistics
from rm3d_plugin.structures.point_cloud import PointCloud, SceneError
from rm3d_plugin.structures.pseudo_labels import UNLABELLED, PseudoLabels
from rm3d_plugin.structures.regions import RegionGraph, Regions, number_by_first_point
from rm3d_plugin.structures.sample import SceneSample
from rm3d_plugin.structures.sample_fields import evaluated_fields, is_nested, nest_predictions, sample_fields
from rm3d_plugin.structures.strays import stray_points

__all__ = [
    'UNLABELLED',
    'Boxes3D',
    'Descriptors',
    'LabelStatistics',
    'PointCloud',
    'PseudoLabels',
    'RegionGraph',
    'Regions',
    'SceneError',
    'SceneSample',
    'box_rows',
    'evaluated_fields',
    'is_nested',
    'nest_predictions',
    'number_by_first_point',
    'sample_fields',
    'stray_points',
]
