"""Steps of a training pipeline: dict of arrays -> dict of arrays, chance only from ``results['rng']``."""

from rm3d_plugin.datasets.transforms.augmented_view import AugmentedView, ViewSettings, augmented_view
from rm3d_plugin.datasets.transforms.geometric import GlobalRotScale, RandomFlipY, flip_y, rotate_scale
from rm3d_plugin.datasets.transforms.pack import PackScene, pack_scene
from rm3d_plugin.datasets.transforms.paste import LabelledObjectPaste
from rm3d_plugin.datasets.transforms.points import DropGround, LimitPoints, select_points

__all__ = [
    'AugmentedView',
    'DropGround',
    'GlobalRotScale',
    'LabelledObjectPaste',
    'LimitPoints',
    'PackScene',
    'RandomFlipY',
    'ViewSettings',
    'augmented_view',
    'flip_y',
    'pack_scene',
    'rotate_scale',
    'select_points',
]
