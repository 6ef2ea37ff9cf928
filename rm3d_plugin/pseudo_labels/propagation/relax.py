"""A few relaxations at the points, so that borders follow points and not the nodes that stood for them."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
import numpy as np
from jaxtyping import Bool, Float
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.pseudo_labels.propagation.point_graph import PointGraph

_BLOCK = 8192  # rows that one thread works on at a time


def relax(
    graph: PointGraph,
    shares: Float[np.ndarray, 'points classes'],
    prior: Float[np.ndarray, 'points classes'],
    strength: Float[np.ndarray, ' points'],
    fixed: Bool[np.ndarray, ' points'],
    sweeps: int,
) -> Float[np.ndarray, 'points classes']:
    """Jacobi's method on (degree + strength) x = weights x + strength prior from ``shares`` on; float32.

    Args:
        graph: Of the points.
        shares: Start.
        prior: What is pulled to.
        strength: Of the pull at each point.
        fixed: Points that keep their row.
        sweeps: Each lets a point see one neighbour farther.
    """
    weights = graph.weights
    csr = weights.indptr, weights.indices, weights.data
    old, pull = shares.astype(np.float32), prior.astype(np.float32)

    def work(start: int, stop: int) -> None:
        _sweep(*csr, graph.degree, strength, pull, fixed, start, stop, old, new)

    for _ in range(sweeps):
        new = old.copy()
        map_blocks(work, len(old), _BLOCK)
        old = new
    return old


@njit(cache=True, nogil=True)
def _sweep(indptr, indices, data, degree, strength, prior, fixed, start, stop, old, new):
    count = old.shape[1]
    total = np.empty(count)
    for row in range(start, stop):
        if fixed[row] or not degree[row] > 0.0:
            continue
        for column in range(count):
            total[column] = strength[row] * prior[row, column]
        for at in range(indptr[row], indptr[row + 1]):
            other, weight = indices[at], data[at]
            for column in range(count):
                total[column] += weight * old[other, column]
        for column in range(count):
            new[row, column] = total[column] / (degree[row] + strength[row])
