"""Neighbours in place and colour, for the smoothness loss and for the propagation at test time."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

NEIGHBOURS = 10
BANDWIDTH = 0.1  # of the squared distance: metres and colours in [0, 1] in one space


class ColourGraph(NamedTuple):
    """Edges from some points to their nearest others.

    Attributes:
        source: (E,) int64 rows of the points.
        target: (E,) int64 rows of the points; no edge leads back to its source.
        weight: (E,) exp(-d^2 / bandwidth), in (0, 1].
    """

    source: Int[np.ndarray, ' edges']
    target: Int[np.ndarray, ' edges']
    weight: Float[np.ndarray, ' edges']


def colour_graph(
    points: Float[np.ndarray, 'points columns'],
    rows: Int[np.ndarray, ' rows'] | None = None,
    neighbours: int = NEIGHBOURS,
    bandwidth: float = BANDWIDTH,
) -> ColourGraph:
    """The nearest neighbours of points in the space of all their columns.

    Args:
        points: (N, D) metres, then channels in [0, 1].
        rows: Points whose neighbours are sought; None: all.
        neighbours: Of each point; fewer where the scene has no more.
        bandwidth: Larger: farther neighbours count more.
    """
    rows = np.arange(len(points)) if rows is None else rows
    count = min(neighbours, len(points) - 1)
    if count < 1:
        nothing = np.zeros(0, dtype=np.int64)
        return ColourGraph(nothing, nothing, np.zeros(0))
    distance, found = cKDTree(points).query(points[rows], k=count + 1)
    own = found == rows[:, None]
    own[:, -1] |= ~own.any(axis=1)  # among many equal points it may miss itself: the farthest goes instead
    source = np.repeat(rows, count)
    return ColourGraph(source, found[~own].astype(np.int64), np.exp(-(distance[~own] ** 2) / bandwidth))
