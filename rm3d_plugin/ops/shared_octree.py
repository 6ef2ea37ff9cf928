"""One octree, and one search for nearest neighbours, for all steps that meet the same points."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.octree import Knn, Octree

CHUNK = 1 << 14  # points whose neighbours are handed out at a time
BLOCK = 2048  # points whose distances one thread computes at a time


@dataclass(eq=False)
class _Shared:
    """An octree over ``points``, and the nearest points of each as far as somebody asked, (N, k) int32."""

    points: np.ndarray
    tree: Octree
    nearest: np.ndarray | None = None


_shared: ContextVar[_Shared | None] = ContextVar('shared octree', default=None)


@contextmanager
def sharing_octree(points: Float[np.ndarray, 'points 3']) -> Iterator[None]:
    """Within, whoever asks for an octree or for neighbours of this very array gets what is there already.

    The array must not be written to meanwhile. Costs 4 bytes a point and neighbour.
    """
    token = _shared.set(_Shared(points, Octree(points)))
    try:
        yield
    finally:
        _shared.reset(token)


def octree_of(points: Float[np.ndarray, 'points 3']) -> Octree:
    """The octree that is shared, if it is of this array, else a new one."""
    shared = _shared_of(points)
    return Octree(points) if shared is None else shared.tree


def nearest_of_each(
    points: Float[np.ndarray, 'points 3'], k: int, chunk: int = CHUNK
) -> Iterator[tuple[Int[np.ndarray, ' some'], Knn]]:
    """The k nearest of the points for each of them, itself among them, some at a time along the Morton curve.

    Within :func:`sharing_octree` the first search is kept, and serves whoever asks for as many or fewer.

    Args:
        points: (N, 3) metres.
        k: At least 1.
        chunk: Points at a time.

    Yields:
        Numbers of some points, and their neighbours in that order.
    """
    shared, tree = _shared_of(points), octree_of(points)
    known = None if shared is None or shared.nearest is None or shared.nearest.shape[1] < k else shared.nearest
    found = np.empty((len(points), k), dtype=np.int32) if shared is not None and known is None else None
    for first in range(0, len(points), chunk):
        rows = tree.order[first : first + chunk]
        near = tree.knn(points[rows], k) if known is None else _known(points, rows, known, k)
        if found is not None:
            found[rows] = near.indices
        yield rows, near
    if shared is not None and found is not None:
        shared.nearest = found


def _shared_of(points: np.ndarray) -> _Shared | None:
    shared = _shared.get()
    return shared if shared is not None and shared.points is points else None


def _known(points: np.ndarray, rows: np.ndarray, known: np.ndarray, k: int) -> Knn:
    indices, sq_dists = np.empty((len(rows), k), dtype=np.int32), np.empty((len(rows), k))
    map_blocks(
        lambda start, stop: _nearest_known(points, rows, known, start, stop, indices, sq_dists), len(rows), BLOCK
    )
    return Knn(indices, sq_dists)


@njit(cache=True, nogil=True)
def _nearest_known(
    points: np.ndarray,
    rows: np.ndarray,
    known: np.ndarray,
    start: int,
    stop: int,
    indices: np.ndarray,
    sq_dists: np.ndarray,
) -> None:
    """Squared distances as the octree computes them: float64 of the coordinates as given."""
    for at in range(start, stop):
        for slot in range(indices.shape[1]):
            j = known[rows[at], slot]
            indices[at, slot], sq_dists[at, slot] = j, np.inf
            if j >= 0:
                dx = np.float64(points[j, 0]) - np.float64(points[rows[at], 0])
                dy = np.float64(points[j, 1]) - np.float64(points[rows[at], 1])
                dz = np.float64(points[j, 2]) - np.float64(points[rows[at], 2])
                sq_dists[at, slot] = dx * dx + dy * dy + dz * dz
