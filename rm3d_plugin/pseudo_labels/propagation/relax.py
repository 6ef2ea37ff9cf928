"""Conjugate gradients at the points, so that an answer follows points and not the nodes that stood for them."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
import numpy as np
from jaxtyping import Bool, Float
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.pseudo_labels.propagation.given_up import still_wanted
from rm3d_plugin.pseudo_labels.propagation.point_graph import PointGraph

_BLOCK = 8192  # rows that one thread works on at a time
_TINY = 1e-30


def relax(
    graph: PointGraph,
    shares: Float[np.ndarray, 'points classes'],
    prior: Float[np.ndarray, 'points classes'],
    strength: Float[np.ndarray, ' points'],
    fixed: Bool[np.ndarray, ' points'],
    steps: int,
) -> Float[np.ndarray, 'points classes']:
    """(degree + strength) x = weights x + strength prior by conjugate gradients from ``shares`` on; float32.

    Each column on its own, scaled by the diagonal (Shewchuk 1994). Nodes that stand for many points make the way from
    a label shorter than it is; this puts it right, the farther the more steps there are.

    Args:
        graph: Of the points.
        shares: Start; rows of sum 1.
        prior: What is pulled to.
        strength: Of the pull at each point.
        fixed: Points that keep their row.
        steps: Each lets a point see one neighbour farther.

    Returns:
        Not negative; rows of sum near 1 where those of the start have it.
    """
    diagonal = (graph.degree + strength).astype(np.float32)[:, None]
    moving = (~fixed & (diagonal[:, 0] > 0))[:, None]
    scale = np.where(moving, 1.0 / np.where(moving, diagonal, 1.0), 0.0).astype(np.float32)
    x = shares.astype(np.float32)
    rest = (strength.astype(np.float32)[:, None] * prior + _spread(graph, x) - diagonal * x) * moving
    way = scale * rest
    length = _dots(rest, way)
    for _ in range(steps):
        still_wanted()
        applied = (diagonal * way - _spread(graph, way)) * moving
        step = (length / np.maximum(_dots(way, applied), _TINY)).astype(np.float32)
        x += step * way
        rest -= step * applied
        ahead = scale * rest
        before, length = length, _dots(rest, ahead)
        way = ahead + (length / np.maximum(before, _TINY)).astype(np.float32) * way
    return np.maximum(x, 0.0)


def _dots(
    one: Float[np.ndarray, 'points classes'], other: Float[np.ndarray, 'points classes']
) -> Float[np.ndarray, ' classes']:
    return np.asarray(np.einsum('ij,ij->j', one, other, dtype=np.float64))


def _spread(graph: PointGraph, values: Float[np.ndarray, 'points classes']) -> Float[np.ndarray, 'points classes']:
    """Weights times values."""
    csr, out = (graph.weights.indptr, graph.weights.indices, graph.weights.data), np.empty_like(values)

    def work(start: int, stop: int) -> None:
        _rows(*csr, start, stop, values, out)

    map_blocks(work, len(values), _BLOCK)
    return out


@njit(cache=True, nogil=True)
def _rows(indptr, indices, data, start, stop, values, out):
    count = values.shape[1]
    total = np.empty(count)
    for row in range(start, stop):
        total[:] = 0.0
        for at in range(indptr[row], indptr[row + 1]):
            other, weight = indices[at], data[at]
            for column in range(count):
                total[column] += weight * values[other, column]
        for column in range(count):
            out[row, column] = total[column]
