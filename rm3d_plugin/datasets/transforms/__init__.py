"""Steps of a training pipeline: dict of arrays -> dict of arrays, chance only from ``results['rng']``."""

from rm3d_plugin.datasets.transforms.augmented_view import AugmentedView, ViewSettings, augmented_view
from rm3d_plugin.datasets.transforms.class_sites import AllLabels, ClassSites
from rm3d_plugin.datasets.transforms.clearance_features import ClearanceFeatures, clearance_columns
from rm3d_plugin.datasets.transforms.crop_pairs import CropPair, CropPairs, PairSettings, crop_pair
from rm3d_plugin.datasets.transforms.geometric import GlobalRotScale, RandomFlipY, flip_y, rotate_scale
from rm3d_plugin.datasets.transforms.indoor import (
    ColorAutoContrast,
    ColorDrop,
    ColorJitter,
    ElasticDistortion,
    RandomCrop,
    auto_contrast,
    elastic,
)
from rm3d_plugin.datasets.transforms.object_sites import ObjectSites, point_objects
from rm3d_plugin.datasets.transforms.outdoor import ClassCrop, HeightAboveGround, class_center, with_heights
from rm3d_plugin.datasets.transforms.overlapping_crops import OverlappingCrops, overlapping_rows
from rm3d_plugin.datasets.transforms.pack import PackScene, pack_scene
from rm3d_plugin.datasets.transforms.paste import LabelledObjectPaste
from rm3d_plugin.datasets.transforms.points import DropGround, LimitPoints, crop_rows, select_points
from rm3d_plugin.datasets.transforms.scan_noise import PointNoise, RandomDownsample, noisy_points
from rm3d_plugin.datasets.transforms.shape_features import ShapeFeatures, shape_columns
from rm3d_plugin.datasets.transforms.sinusoidal_position import SinusoidalPosition, place_columns
from rm3d_plugin.datasets.transforms.voxel_units import VoxelUnits

__all__ = [
    'AllLabels',
    'AugmentedView',
    'ClassCrop',
    'ClassSites',
    'ClearanceFeatures',
    'ColorAutoContrast',
    'ColorDrop',
    'ColorJitter',
    'CropPair',
    'CropPairs',
    'DropGround',
    'ElasticDistortion',
    'GlobalRotScale',
    'LabelledObjectPaste',
    'HeightAboveGround',
    'LimitPoints',
    'OverlappingCrops',
    'ObjectSites',
    'PackScene',
    'PairSettings',
    'PointNoise',
    'RandomCrop',
    'RandomFlipY',
    'RandomDownsample',
    'SinusoidalPosition',
    'ShapeFeatures',
    'ViewSettings',
    'VoxelUnits',
    'augmented_view',
    'auto_contrast',
    'class_center',
    'clearance_columns',
    'crop_pair',
    'crop_rows',
    'elastic',
    'flip_y',
    'noisy_points',
    'overlapping_rows',
    'pack_scene',
    'place_columns',
    'point_objects',
    'rotate_scale',
    'select_points',
    'shape_columns',
    'with_heights',
]
