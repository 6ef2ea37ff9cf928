"""Frozen, checked containers."""

from rm3d_plugin.structures.boxes3d import Boxes3D
from rm3d_plugin.structures.descriptors import Descriptors
from rm3d_plugin.structures.label_statistics import LabelStatistics
from rm3d_plugin.structures.point_cloud import PointCloud, SceneError
from rm3d_plugin.structures.pseudo_labels import UNLABELLED, PseudoLabels
from rm3d_plugin.structures.regions import RegionGraph, Regions, number_by_first_point
from rm3d_plugin.structures.sample import SceneSample
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
    'number_by_first_point',
    'stray_points',
]
