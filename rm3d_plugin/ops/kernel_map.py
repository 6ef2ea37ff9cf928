"""Pairs of input and output voxels per kernel offset: built once per level and shared by its layers."""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Int32, Int64
from numba import njit
from torch import Tensor

from rm3d_plugin.ops.voxelize import AXIS_BITS, COORDINATE_LIMIT, Array, pack_coords, unique_rows

Triple = tuple[int, int, int]
_REACH_LIMIT = 1 << 9


def triple(value: int | tuple[int, ...], name: str) -> Triple:
    """``value`` for x, y and z, each at least 1.

    Raises:
        ValueError: If it is neither a positive integer nor three of them.
    """
    values = (value, value, value) if isinstance(value, int) else tuple(value)
    if len(values) != 3 or any(not isinstance(v, int) or v < 1 for v in values):
        raise ValueError(f'{name} must be a positive integer or three of them, got {value!r}')
    return (values[0], values[1], values[2])


class KernelSpec(NamedTuple):
    """Shape of a convolution in voxels, per axis x, y, z."""

    kernel_size: Triple
    stride: Triple = (1, 1, 1)
    dilation: Triple = (1, 1, 1)

    def offsets(self) -> list[Triple]:
        """Input minus strided output coordinate per weight, z fastest: centred for odd sizes, from 0 for even ones.

        >>> KernelSpec((3, 1, 1)).offsets()
        [(-1, 0, 0), (0, 0, 0), (1, 0, 0)]
        """
        axes = [
            [d * (i - (k // 2 if k % 2 else 0)) for i in range(k)]
            for k, d in zip(self.kernel_size, self.dilation, strict=True)
        ]
        x_axis, y_axis, z_axis = axes
        return list(product(x_axis, y_axis, z_axis))


@dataclass(frozen=True)
class KernelMap:
    """Pairs (input row, output row) of a convolution, grouped by kernel offset.

    Within an offset both columns rise and no row occurs twice: a row is written once per offset, in a fixed order.

    Attributes:
        pair_in: Input row of each pair.
        pair_out: Output row of each pair.
        starts: Offset ``k`` owns the pairs ``starts[k]`` to ``starts[k + 1]``; a numpy array, always on the host.
        n_in: Number of input rows.
        n_out: Number of output rows.
    """

    pair_in: Int32[Tensor, 'pairs']
    pair_out: Int32[Tensor, 'pairs']
    starts: Int64[np.ndarray, 'offsets_plus_1']
    n_in: int
    n_out: int
    _tables: dict[bool, Tensor] = field(default_factory=dict, repr=False, compare=False)  # shared with the transposed
    _turned: bool = field(default=False, repr=False, compare=False)

    def transposed(self) -> 'KernelMap':
        """The map of the inverse convolution: from the output rows back to the input rows."""
        return KernelMap(
            self.pair_out, self.pair_in, self.starts, self.n_out, self.n_in, self._tables, not self._turned
        )

    @property
    def table(self) -> Int32[Tensor, 'outputs offsets']:
        """Input row of each output row and offset; ``n_in`` where there is none. Made on first use."""
        if self._turned not in self._tables:
            table = self.pair_in.new_full((self.n_out, len(self.starts) - 1), self.n_in)
            table[self.pair_out.long(), self._offset_of_pairs()] = self.pair_in
            self._tables[self._turned] = table
        return self._tables[self._turned]

    @cached_property
    def padded_pairs(self) -> tuple[Int32[Tensor, '2 offsets most'], Int32[Tensor, 'offsets']]:
        """The pairs as spconv takes them, filled up with -1, and their number for each offset."""
        starts = torch.from_numpy(self.starts).to(self.pair_in.device)
        pairs = self.pair_in.new_full((2, len(starts) - 1, max(self.n_in, self.n_out, 1)), -1)
        offset = self._offset_of_pairs()
        place = torch.arange(len(offset), device=offset.device) - starts[offset]
        pairs[0, offset, place], pairs[1, offset, place] = self.pair_in, self.pair_out
        return pairs, starts.diff().int()

    def nbytes(self) -> int:
        """Memory of the pairs and of what was made from them so far."""
        return self.pair_in.nbytes + self.pair_out.nbytes + sum(table.nbytes for table in self._tables.values())

    def _offset_of_pairs(self) -> Int64[Tensor, 'pairs']:
        counts = torch.from_numpy(self.starts).diff().to(self.pair_in.device)
        return torch.arange(len(counts), device=counts.device).repeat_interleave(counts, output_size=len(self.pair_in))


@dataclass
class VoxelLevel:
    """The voxels of one resolution, with the maps and the coarser levels made from it so far.

    Attributes:
        coords: Columns batch, x, y, z; unique and sorted.
    """

    coords: Int64[Tensor, 'voxels 4']
    _keys: Tensor = field(init=False, repr=False)
    _maps: dict[KernelSpec, KernelMap] = field(init=False, repr=False, default_factory=dict)
    _coarser: dict[Triple, 'VoxelLevel'] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        if self.coords.ndim != 2 or self.coords.shape[1] != 4 or self.coords.dtype != torch.int64:
            raise ValueError(
                f'coords must be int64 (V, 4) as voxelize gives, got {self.coords.dtype} {tuple(self.coords.shape)}'
            )
        if bool((self.coords[:, 1:].abs() > COORDINATE_LIMIT).any()):
            raise ValueError(f'voxel coordinates must stay within +-{COORDINATE_LIMIT}; move the scene to its origin')
        self._keys = pack_coords(self.coords)
        if bool((self._keys.diff() <= 0).any()):
            raise ValueError('coords must be unique and sorted by (batch, x, y, z), as voxelize gives them')

    def __len__(self) -> int:
        return len(self.coords)

    @property
    def keys(self) -> Int64[Tensor, 'voxels']:
        """The coordinates, packed: equal for equal coordinates only."""
        return self._keys

    def nbytes(self) -> int:
        """Memory of the level, and of all maps and coarser levels made from it so far."""
        own = self.coords.nbytes + self._keys.nbytes
        maps = sum(kernel_map.nbytes() for kernel_map in self._maps.values())
        return own + maps + sum(level.nbytes() for level in self._coarser.values())

    def coarser(self, stride: Triple) -> 'VoxelLevel':
        """The level of the cells ``floor(coordinate / stride)`` that hold a voxel; built on first use."""
        if stride == (1, 1, 1):
            return self
        if stride not in self._coarser:
            steps = self.coords.new_tensor([1, *stride])
            cells = torch.div(self.coords, steps, rounding_mode='floor')
            self._coarser[stride] = VoxelLevel(unique_rows(cells).coords)
        return self._coarser[stride]

    def kernel_map(self, spec: KernelSpec) -> KernelMap:
        """The pairs of a convolution from this level to :meth:`coarser` of its stride; built on first use."""
        if spec not in self._maps:
            self._maps[spec] = _build_map(self, self.coarser(spec.stride), spec)
        return self._maps[spec]


def _build_map(source: VoxelLevel, target: VoxelLevel, spec: KernelSpec) -> KernelMap:
    offsets = spec.offsets()
    if max(abs(v) for offset in offsets for v in offset) > _REACH_LIMIT:
        raise ValueError(f'a kernel reaches at most {_REACH_LIMIT} voxels, got {spec}')
    deltas = [((x << AXIS_BITS) + y << AXIS_BITS) + z for x, y, z in offsets]
    anchors = pack_coords(target.coords * target.coords.new_tensor([1, *spec.stride]))
    if source.coords.device.type != 'cpu':
        pair_in, pair_out, counts = _pairs_searched(source._keys, anchors, deltas)
    else:
        mirrored = source is target and all(size % 2 == 1 for size in spec.kernel_size)
        keys = np.append(source._keys.numpy(), np.iinfo(np.int64).max)
        columns = np.array(deltas).reshape(-1, spec.kernel_size[2])
        found_in, found_out, found = _pairs_merged(keys, anchors.numpy(), columns, mirrored)
        pair_in, pair_out, counts = torch.from_numpy(found_in), torch.from_numpy(found_out), found.tolist()
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return KernelMap(pair_in, pair_out, starts, len(source), len(target))


def _pairs_searched(keys: Tensor, anchors: Tensor, deltas: list[int]) -> tuple[Tensor, Tensor, list[int]]:
    """Pairs by binary search in plain torch; runs on any device, and waits for it once."""
    wanted = anchors + keys.new_tensor(deltas)[:, None]
    place = torch.searchsorted(keys, wanted).clamp_(max=max(len(keys) - 1, 0))
    hit = keys[place] == wanted
    counts = hit.sum(dim=1).tolist()
    offset, row = hit.nonzero(as_tuple=True)
    return place[offset, row].int(), row.int(), counts


@njit(cache=True, nogil=True)
def _pairs_merged(keys: Array, anchors: Array, columns: Array, mirrored: bool) -> tuple[Array, Array, Array]:
    """Pairs by merging two sorted lists: read in order, nothing is searched.

    Args:
        keys: Sorted keys of the input voxels, closed by a key larger than any.
        anchors: Sorted keys of the first input voxel under each output voxel.
        columns: Key differences of the offsets, one row for each x and y: its voxels lie next to each other.
        mirrored: Whether inputs and outputs are the same voxels and the kernel is symmetric: then offset ``k`` is
            offset ``-k`` with its columns swapped, and half of the merging is saved.
    """
    height = columns.shape[1]
    offsets = columns.size
    searched = offsets // 2 if mirrored else offsets
    rows_in = np.empty((searched, len(anchors) + 1), np.int32)  # one more: a miss writes where the next hit will
    rows_out = np.empty((searched, len(anchors) + 1), np.int32)
    counts = np.zeros(offsets, np.int64)
    for column in range((searched + height - 1) // height):
        first = column * height
        levels = min(height, searched - first)
        i = 0
        for j in range(len(anchors)):
            while keys[i] < anchors[j] + columns[column, 0]:
                i += 1
            place = i
            for level in range(levels):
                wanted = anchors[j] + columns[column, level]
                while keys[place] < wanted:
                    place += 1
                found = counts[first + level]
                rows_in[first + level, found] = place
                rows_out[first + level, found] = j
                hit = int(keys[place] == wanted)
                counts[first + level] += hit
                place += hit
    if mirrored:
        counts[searched] = len(anchors)
        for k in range(searched):
            counts[offsets - 1 - k] = counts[k]
    pair_in = np.empty(counts.sum(), np.int32)
    pair_out = np.empty(counts.sum(), np.int32)
    start = 0
    for k in range(offsets):
        stop = start + counts[k]
        if k < searched:
            pair_in[start:stop] = rows_in[k, : counts[k]]
            pair_out[start:stop] = rows_out[k, : counts[k]]
        elif k == searched:
            pair_in[start:stop] = np.arange(len(anchors))
            pair_out[start:stop] = np.arange(len(anchors))
        else:
            pair_in[start:stop] = rows_out[offsets - 1 - k, : counts[k]]
            pair_out[start:stop] = rows_in[offsets - 1 - k, : counts[k]]
        start = stop
    return pair_in, pair_out, counts
