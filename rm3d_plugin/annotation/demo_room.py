"""A made-up room to try the page on."""

from pathlib import Path

import numpy as np

from rm3d_plugin.datasets.synthetic.rooms import make_room
from rm3d_plugin.storage.ply import write_ply

POINTS = 60_000
SEED, SPACING = 7, 0.02  # metres


def write_demo_room(folder: Path) -> Path:
    """Write ``room.ply`` without labels, unless it is there; the file.

    Args:
        folder: Is made.
    """
    path = folder / 'room.ply'
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        room = make_room(SEED, 0, SPACING)
        kept = np.random.default_rng(0).permutation(len(room))[:POINTS]
        columns = {axis: room.aligned[kept, i] for i, axis in enumerate('xyz')}
        colors = zip(('red', 'green', 'blue'), room.colors[kept].T, strict=True)
        write_ply(path, columns | {name: values.astype(np.uint8) for name, values in colors})
    return path
