"""Made-up scenes in the native formats of real data sets; every one says that it is synthetic."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rm3d_plugin.datasets.synthetic.kitti_writer import make_streets
from rm3d_plugin.datasets.synthetic.s3dis_writer import make_s3dis_rooms
from rm3d_plugin.datasets.synthetic.scannet_writer import make_scannet_rooms
from rm3d_plugin.datasets.synthetic.semantic3d_writer import make_semantic3d_streets
from rm3d_plugin.datasets.synthetic.semantickitti_writer import make_semantickitti_streets
from rm3d_plugin.datasets.synthetic.vkitti_writer import make_vkitti_streets
from rm3d_plugin.datasets.synthetic.waymo_writer import make_waymo_streets

DEMO_SCENES: dict[str, Callable[..., Path]] = {
    'streets': make_streets,
    'scannet_rooms': make_scannet_rooms,
    's3dis_rooms': make_s3dis_rooms,
    'semantickitti_streets': make_semantickitti_streets,
    'semantic3d_streets': make_semantic3d_streets,
    'vkitti_streets': make_vkitti_streets,
    'waymo_streets': make_waymo_streets,
}


def make_demo(root: str | Path, scenes: str = 'streets', **settings: Any) -> Path:
    """Make demo data, or leave it as it is where it is complete and of these settings.

    Args:
        root: Folder to fill.
        scenes: Key of :data:`DEMO_SCENES`.
        settings: Of that maker.

    Raises:
        ValueError: There are no such scenes or settings, or the folder holds what was not made here.
    """
    if scenes not in DEMO_SCENES:
        raise ValueError(f'demo_data.scenes: expected one of {", ".join(DEMO_SCENES)}, got {scenes!r}')
    maker = DEMO_SCENES[scenes]
    known = list(inspect.signature(maker).parameters)[1:]
    if strange := sorted(set(settings) - set(known)):
        raise ValueError(f'demo_data.{strange[0]}: no such setting of {scenes}; expected some of {", ".join(known)}')
    return maker(root, **settings)


__all__ = [
    'DEMO_SCENES',
    'make_demo',
    'make_s3dis_rooms',
    'make_scannet_rooms',
    'make_semantic3d_streets',
    'make_semantickitti_streets',
    'make_streets',
    'make_vkitti_streets',
    'make_waymo_streets',
]
