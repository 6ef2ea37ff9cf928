"""Level ground: road and pavement lie in one plane, and no region ends where they meet, but for a step of the kerb."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from rm3d_plugin.structures import UNLABELLED, RegionGraph

STEP = 0.03  # m of height that count as a metre sideways: a kerb keeps two classes apart


def level_regions(graph: RegionGraph, least: float | None) -> Bool[np.ndarray, ' regions']:
    """Regions whose mean unit normal is upright: its height is at least ``least``; None: no region is."""
    return np.asarray(np.abs(graph.normals[:, 2]) >= (np.inf if least is None else least))


def nearest_level_classes(
    xyz: Float[np.ndarray, 'points 3'],
    level: Bool[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    reach: float | None,
) -> Int[np.ndarray, ' points']:
    """For each level point the class of the nearest revealed one among them; heights count 1 / :data:`STEP` times.

    Args:
        xyz: Metres, z up.
        level: Points that take part.
        true_labels: True class of each point, -1 = unknown.
        reach: Metres; larger distances name nothing. None: no limit.

    Returns:
        (N,) int64, -1 for other points and out of reach.

    >>> xyz = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0.15], [5, 0, 0.15]])
    >>> nearest_level_classes(xyz, np.ones(4, dtype=bool), np.array([3, -1, -1, 4]), None)
    array([3, 3, 4, 4])
    """
    out = np.full(len(xyz), UNLABELLED, dtype=np.int64)
    own = np.flatnonzero(level & (true_labels >= 0))
    if len(own):
        where = xyz / np.array([1.0, 1.0, STEP])
        limit = np.inf if reach is None else reach
        distance, nearest = cKDTree(where[own]).query(where[level], distance_upper_bound=limit)
        out[level] = np.append(true_labels[own], UNLABELLED)[np.where(np.isfinite(distance), nearest, len(own))]
    return out
