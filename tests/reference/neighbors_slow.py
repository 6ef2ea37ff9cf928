"""Neighbours by looking at every point."""

import numpy as np


def squared_distances(points, queries):
    """(M, N) squared distances in float64, summed axis by axis."""
    delta = np.asarray(points, dtype=np.float64)[None] - np.asarray(queries, dtype=np.float64)[:, None]
    squares = delta * delta
    return (squares[..., 0] + squares[..., 1]) + squares[..., 2]


def slow_neighbors(points, queries, radius=np.inf, k=None):
    """For each query its points within ``radius``, at most ``k``, by distance, then number; with squared distances."""
    radii = np.broadcast_to(radius, (len(queries),))
    rows = []
    for squares, reach in zip(squared_distances(points, queries), radii, strict=True):
        order = np.lexsort((np.arange(len(points)), squares))
        order = order[squares[order] <= reach * reach][:k]
        rows.append((order, squares[order]))
    return rows
