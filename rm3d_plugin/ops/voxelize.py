"""Points to voxels and back: sorted, unique integer coordinates with one feature row each."""

from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int64
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

from rm3d_plugin.structures import SceneError

Array = np.ndarray[Any, Any]
AXIS_BITS = 17
BATCH_BITS = 12
_HALF = 1 << (AXIS_BITS - 1)
_MARGIN = 1 << 10  # room for kernel offsets: a neighbour's key never runs over into the next axis
COORDINATE_LIMIT = _HALF - _MARGIN
BATCH_LIMIT = 1 << BATCH_BITS


class Voxels(NamedTuple):
    """Voxels of a batch, sorted by (batch, x, y, z).

    Attributes:
        features: One row per voxel; differentiable with respect to the point features.
        coords: Columns batch, x, y, z in voxels; unique and sorted, so that neighbours in space lie close in memory.
        point_to_voxel: Row of ``features`` for every point.
    """

    features: Float[Tensor, 'voxels channels']
    coords: Int64[Tensor, 'voxels 4']
    point_to_voxel: Int64[Tensor, 'points']


def voxelize(
    points: Float[Tensor, 'points 3'],
    features: Float[Tensor, 'points channels'],
    batch_offsets: Int64[Tensor, 'scenes_plus_1'],
    voxel_size: float,
    reduce: Literal['mean', 'first'] = 'mean',
) -> Voxels:
    """Gather the points of each scene into cubic voxels (METHOD 7).

    Args:
        points: Metres, in each scene's local frame.
        features: One row per point.
        batch_offsets: Scene ``b`` owns points ``batch_offsets[b]`` to ``batch_offsets[b + 1]``; scenes may be empty.
        voxel_size: Edge in metres; larger: fewer, coarser voxels.
        reduce: ``'mean'`` of the points of a voxel, or the features of its ``'first'`` point (lowest index).

    Returns:
        The non-empty voxels; the same bits whatever the number of threads.

    Raises:
        ValueError: If shapes disagree, or there are more than 4096 scenes.
        SceneError: If a coordinate is not finite, or a voxel lies beyond the packed range, +-64512 from the origin.
    """
    _check_points(points, features, batch_offsets, voxel_size, reduce)
    scenes = torch.repeat_interleave(
        torch.arange(len(batch_offsets) - 1, device=points.device), batch_offsets.diff(), output_size=len(points)
    )
    cells = torch.floor(points.detach().double() / voxel_size)
    _check_range(cells, voxel_size)
    unique = unique_rows(torch.cat([scenes[:, None], cells.long()], dim=1))
    if reduce == 'mean':
        counts = torch.bincount(unique.inverse, minlength=len(unique.coords))
        rows = sum_rows(features, unique.inverse, len(counts)) / counts[:, None].to(features.dtype)
    else:
        rows = gather_rows(features, unique.first)
    return Voxels(rows, unique.coords, unique.inverse)


class UniqueRows(NamedTuple):
    """Distinct coordinates of many.

    Attributes:
        coords: The distinct rows, sorted by (batch, x, y, z).
        inverse: Row of ``coords`` for every input row.
        first: Lowest input row of each distinct row.
    """

    coords: Int64[Tensor, 'voxels 4']
    inverse: Int64[Tensor, 'points']
    first: Int64[Tensor, 'voxels']


def unique_rows(coords: Int64[Tensor, 'points 4']) -> UniqueRows:
    """The distinct coordinates, sorted, with the maps there and back."""
    if coords.device.type == 'cpu':
        order = _sorted_order(np.ascontiguousarray(coords.numpy().T))
        inverse, first = (torch.from_numpy(a) for a in _number_runs(coords.contiguous().numpy(), order))
        return UniqueRows(coords[first], inverse, first)
    keys, inverse = torch.unique(pack_coords(coords), sorted=True, return_inverse=True)
    order = torch.sort(inverse, stable=True).indices
    counts = torch.bincount(inverse, minlength=len(keys))
    return UniqueRows(unpack_coords(keys), inverse, order[counts.cumsum(0) - counts])


def pack_coords(coords: Int64[Tensor, 'voxels 4']) -> Int64[Tensor, 'voxels']:
    """One sortable key per voxel: 12 bits of batch, then 17 bits of x, y and z; its order is (batch, x, y, z)."""
    shifted = coords + coords.new_tensor([0, _HALF, _HALF, _HALF])
    batch, x, y, z = shifted.unbind(1)
    return (((batch << AXIS_BITS | x) << AXIS_BITS | y) << AXIS_BITS) | z


def unpack_coords(keys: Int64[Tensor, 'voxels']) -> Int64[Tensor, 'voxels 4']:
    """The coordinates (batch, x, y, z) of :func:`pack_coords` keys."""
    mask = (1 << AXIS_BITS) - 1
    axes = [(keys >> (AXIS_BITS * i) & mask) - _HALF for i in (2, 1, 0)]
    return torch.stack([keys >> (3 * AXIS_BITS), *axes], dim=1)


def gather_rows(
    features: Float[Tensor, 'rows channels'], index: Int64[Tensor, 'picks']
) -> Float[Tensor, 'picks channels']:
    """``features[index]`` whose gradient is summed in a fixed order (torch's own varies with threads and on CUDA)."""
    return _GatherRows.apply(features, index)  # type: ignore[no-untyped-call]


def sum_rows(
    features: Float[Tensor, 'points channels'], index: Int64[Tensor, 'points'], segments: int
) -> Float[Tensor, 'segments channels']:
    """Sum of the rows of each segment, added in the order of the rows (torch's ``index_add_`` promises none)."""
    return _SumRows.apply(features, index, segments)  # type: ignore[no-untyped-call]


class _GatherRows(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, index: Tensor) -> Tensor:
        ctx.save_for_backward(index)
        ctx.rows = len(features)
        return features.index_select(0, index)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None]:
        (index,) = ctx.saved_tensors
        return _ordered_sum(grad, index, ctx.rows), None


class _SumRows(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, index: Tensor, segments: int) -> Tensor:
        ctx.save_for_backward(index)
        return _ordered_sum(features, index, segments)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None, None]:
        (index,) = ctx.saved_tensors
        return grad.index_select(0, index), None, None


def _ordered_sum(rows: Tensor, index: Tensor, segments: int) -> Tensor:
    if rows.device.type == 'cpu' and rows.dtype in (torch.float32, torch.float64):
        out = rows.new_zeros((segments, rows.shape[1]))
        _add_rows(out.numpy(), rows.contiguous().numpy(), index.numpy())
        return out
    order = torch.sort(index, stable=True).indices
    lengths = torch.bincount(index, minlength=segments)
    return torch.segment_reduce(rows.index_select(0, order), 'sum', lengths=lengths, axis=0, initial=0)


@njit(cache=True, nogil=True)
def _sorted_order(columns: Array) -> Array:
    """Stable order of the coordinates, z least: counting sort by 11 bits of one axis at a time."""
    order = np.arange(columns.shape[1])
    target = np.empty_like(order)
    if len(order) == 0:
        return order
    for axis in range(len(columns) - 1, -1, -1):
        column = columns[axis]
        low, extent = column.min(), column.max() - column.min()
        shift = 0
        while extent >> shift > 0:
            places = np.zeros(2049, np.int64)
            for i in range(len(column)):
                places[((column[i] - low) >> shift & 2047) + 1] += 1
            for digit in range(2048):
                places[digit + 1] += places[digit]
            for i in range(len(order)):
                digit = (column[order[i]] - low) >> shift & 2047
                target[places[digit]] = order[i]
                places[digit] += 1
            order, target = target, order
            shift += 11
    return order


@njit(cache=True, nogil=True)
def _number_runs(coords: Array, order: Array) -> tuple[Array, Array]:
    """Number of the distinct row that each row equals, and the first row of each number, given their order."""
    inverse = np.empty(len(order), np.int64)
    first = np.empty(len(order), np.int64)
    count = 0
    for i in range(len(order)):
        row = coords[order[i]]
        last = coords[order[i - 1]] if i > 0 else row
        differs = i == 0
        for axis in range(4):
            differs = differs or row[axis] != last[axis]
        if differs:
            first[count] = order[i]
            count += 1
        inverse[order[i]] = count - 1
    return inverse, first[:count].copy()


@njit(cache=True, nogil=True)
def _add_rows(out: Array, rows: Array, index: Array) -> None:
    for i in range(len(index)):
        target, row = out[index[i]], rows[i]
        for c in range(len(row)):
            target[c] += row[c]


def _check_points(points: Tensor, features: Tensor, batch_offsets: Tensor, voxel_size: float, reduce: str) -> None:
    if points.ndim != 2 or points.shape[1] != 3 or features.ndim != 2 or len(features) != len(points):
        raise ValueError(
            f'points must be (N, 3) and features (N, C), got {tuple(points.shape)} and {tuple(features.shape)}'
        )
    sizes = batch_offsets.diff()
    if len(batch_offsets) < 2 or batch_offsets[0] != 0 or batch_offsets[-1] != len(points) or bool((sizes < 0).any()):
        raise ValueError(
            f'batch_offsets must rise from 0 to the number of points ({len(points)}), got {batch_offsets.tolist()}'
        )
    if len(batch_offsets) - 1 > BATCH_LIMIT:
        raise ValueError(f'a batch holds at most {BATCH_LIMIT} scenes, got {len(batch_offsets) - 1}')
    if not voxel_size > 0:
        raise ValueError(f'voxel_size must be a positive length in metres, got {voxel_size}')
    if reduce not in ('mean', 'first'):
        raise ValueError(f"reduce must be 'mean' or 'first', got {reduce!r}")


def _check_range(cells: Tensor, voxel_size: float) -> None:
    bad = ~(cells.abs() <= COORDINATE_LIMIT).all(dim=1)
    if bool(bad.any()):
        row = int(bad.nonzero()[0])
        raise SceneError(
            f'point {row} lies at voxel {cells[row].tolist()}; each coordinate must be finite and within '
            f'+-{COORDINATE_LIMIT} voxels of {voxel_size} m. Move the scene to a local frame (PointCloud.origin), '
            f'drop invalid points, or use larger voxels.'
        )
