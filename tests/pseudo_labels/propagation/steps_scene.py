"""A scene that a nearest label gets wrong: two long shelves over a floor, close to each other."""

import numpy as np

from rm3d_plugin.structures import UNLABELLED, PointCloud

FLOOR, SHELF, WALL = 0, 1, 2


def sheet(rng, count, size, corner, axis, noise=0.002):
    """Points on a rectangle that stands across an axis, metres."""
    points = rng.uniform(0.0, 1.0, (count, 3)) * size + corner
    points[:, axis] = corner[axis] + rng.normal(0.0, noise, count)
    return points


def scene(seed=0, colors=True):
    """Floor, a shelf 0.3 m over it, and a wall; with their classes."""
    rng = np.random.default_rng(seed)
    parts = [
        sheet(rng, 2500, (4.0, 3.0, 0.0), (0.0, 0.0, 0.0), 2),
        sheet(rng, 1200, (3.0, 1.0, 0.0), (0.5, 1.0, 0.3), 2),
        sheet(rng, 1500, (4.0, 0.0, 2.0), (0.0, 3.02, 0.0), 1),
    ]
    shades = np.array([[0.5, 0.4, 0.3], [0.7, 0.6, 0.5], [0.8, 0.8, 0.8]])
    semantic = np.repeat([FLOOR, SHELF, WALL], [len(part) for part in parts])
    own = np.clip(shades[semantic] + rng.normal(0.0, 0.05, (len(semantic), 3)), 0, 1) if colors else None
    return PointCloud(np.concatenate(parts), colors=own), semantic.astype(np.int64)


def clicks(semantic, each, seed=0):
    """So many labels of each class, -1 elsewhere."""
    rng, out = np.random.default_rng(seed), np.full(len(semantic), UNLABELLED, dtype=np.int64)
    for own in np.unique(semantic):
        chosen = rng.choice(np.flatnonzero(semantic == own), each, replace=False)
        out[chosen] = own
    return out
