"""Scenes that do not fit: overlapping columns of points, and the mean of what is said of each point."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

CORE_SHARE = 0.75  # of a chunk's points at most; the rest is room for the margin


Progress = Callable[[Sequence['Chunk']], Iterable['Chunk']]
"""Hands on chunks one by one and may show how far it is."""


class Chunk(NamedTuple):
    """Points that are predicted together.

    Attributes:
        rows: (n,) int64 points of the scene, ascending.
        weights: (n,) float32 in (0, 1]: 1 in the core, falling towards the outer edge of the margin.
    """

    rows: Int[np.ndarray, ' points']
    weights: Float[np.ndarray, ' points']


class _Node(NamedTuple):
    core: Int[np.ndarray, ' core']
    around: Int[np.ndarray, ' candidates']  # the core and whatever may lie in its margin


def make_chunks(
    xyz: Float[np.ndarray, 'points 3'],
    max_points: int | None = None,
    chunk_size: float | None = None,
    margin: float = 1.0,
) -> list[Chunk]:
    """Cut a scene into upright columns with a common margin.

    Each point lies in the core of exactly one chunk, and in the margins of its neighbours. The answer depends on the
    points and their order alone.

    Args:
        xyz: (N, 3) metres, finite, z up.
        max_points: Most points of a chunk, margin included. A scene with no more stays whole. A column with more points
            than that is halved; a margin with more keeps the points nearest to the core.
        chunk_size: Metres; edge of the columns seen from above. None: columns as ``max_points`` wants them.
        margin: Metres that a chunk reaches beyond its core; larger: more context at the borders, more work.

    Returns:
        One chunk with all points where nothing asks for more; none for an empty scene.
    """
    everything = np.arange(len(xyz))
    if len(xyz) == 0:
        return []
    if (max_points is None and chunk_size is None) or (max_points is not None and len(xyz) <= max_points):
        return [Chunk(everything, np.ones(len(xyz), dtype=np.float32))]
    plane = np.asarray(xyz[:, :2], dtype=np.float64)
    cells = None if chunk_size is None else np.floor((plane - plane.min(axis=0)) / chunk_size)
    room = None if max_points is None else max(1, int(CORE_SHARE * max_points))
    waiting, chunks = [_Node(everything, everything)], []
    while waiting:
        node = waiting.pop()
        halves = _halves(plane, cells, node.core, room)
        if halves is None:
            chunks.append(_with_margin(plane, node, margin, max_points))
        else:
            waiting += [_Node(core, _near(plane, core, node.around, margin)) for core in reversed(halves)]
    return chunks


def _halves(
    plane: np.ndarray, cells: np.ndarray | None, core: np.ndarray, room: int | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Two parts of a core that spans several cells or has too many points; None where it may stay."""
    if cells is not None:
        low, high = cells[core].min(axis=0), cells[core].max(axis=0)
        axis = int((high - low).argmax())
        if high[axis] > low[axis]:
            left = cells[core, axis] < np.floor((low[axis] + high[axis] + 1) / 2)
            return core[left], core[~left]
    if room is None or len(core) <= room:
        return None
    axis = int(np.ptp(plane[core], axis=0).argmax())
    order = core[np.argsort(plane[core, axis], kind='stable')]
    return np.sort(order[: len(order) // 2]), np.sort(order[len(order) // 2 :])


def _gap(plane: np.ndarray, core: np.ndarray, rows: np.ndarray) -> Float[np.ndarray, ' rows']:
    """Metres from the rectangle around a core, the larger of both axes; 0 within."""
    low, high = plane[core].min(axis=0), plane[core].max(axis=0)
    return np.maximum(np.maximum(low - plane[rows], plane[rows] - high), 0.0).max(axis=1)


def _near(plane: np.ndarray, core: np.ndarray, around: np.ndarray, margin: float) -> np.ndarray:
    return around[_gap(plane, core, around) < margin] if margin > 0 else core


def _without(rows: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Rows that are not among some of them; both ascending."""
    kept = np.ones(len(rows), dtype=bool)
    kept[np.searchsorted(rows, some)] = False
    return rows[kept]


def _with_margin(plane: np.ndarray, node: _Node, margin: float, max_points: int | None) -> Chunk:
    others = _without(node.around, node.core)
    gap = _gap(plane, node.core, others)
    reach, room = margin, len(others) if max_points is None else max(0, max_points - len(node.core))
    if len(others) > room:
        order = np.argsort(gap, kind='stable')
        reach = float(gap[order[room]])
        others, gap = others[order[:room]], gap[order[:room]]
    weight = np.maximum(1.0 - gap / reach, 1e-3) if reach > 0 else np.full(len(others), 1e-3)
    rows = np.concatenate([node.core, others])
    weights = np.concatenate([np.ones(len(node.core)), weight]).astype(np.float32)
    order = np.argsort(rows)
    return Chunk(rows[order], weights[order])


def average_rows(
    chunks: Sequence[Chunk],
    num_points: int,
    predict: Callable[[Tensor], Float[Tensor, 'points columns']],
    progress: Progress = iter,
) -> Float[Tensor, 'all columns']:
    """What is said of each point, the mean over its chunks by their weights; on the CPU, float32.

    Memory grows with the scene by one row a point; all else is bounded by the largest chunk. With one chunk the rows
    are the very ones of ``predict``.

    Args:
        chunks: At least one; together they hold every point.
        num_points: N.
        predict: Rows of the scene (n,) int64 -> (n, columns).
        progress: Shows how far it is.
    """
    if len(chunks) == 1:
        return predict(torch.from_numpy(chunks[0].rows)).cpu()
    total: Tensor | None = None
    weight = torch.zeros(num_points, 1)
    for chunk in progress(chunks):
        rows, own = torch.from_numpy(chunk.rows), torch.from_numpy(chunk.weights)[:, None]
        values = predict(rows).float().cpu()
        if total is None:
            total = torch.zeros(num_points, values.shape[1])
        total[rows] += values * own  # a chunk names each row once
        weight[rows] += own
    assert total is not None
    return total / weight
