"""The octants of an octree from sorted codes: the top of the tree first, then the parts below it, which threads share.

The cuts depend on the points alone, so the numbers of the octants do too, whatever the number of threads.
"""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN201, ANN202
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt64
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.morton import BITS, gather_bits

PART = 1 << 17  # points of a part of the tree that one thread builds, at most


class Octants(NamedTuple):
    """Octants, parents before children, siblings side by side.

    Attributes:
        nodes: (O, 5) int32 first point, end, first child, children, level.
        boxes: (O, 6) tight bounds of the points as low xyz, high xyz, metres.
        cubes: (O, 4) centre and half edge, metres from the grid's lowest corner.
    """

    nodes: Int[np.ndarray, 'octants 5']
    boxes: Float[np.ndarray, 'octants 6']
    cubes: Float[np.ndarray, 'octants 4']


def build_octants(
    columns: Float[np.ndarray, '3 points'], codes: UInt64[np.ndarray, ' points'], leaf_size: int, edge: float
) -> Octants:
    """Octants over points along the Morton curve.

    Args:
        columns: Coordinates in the order of ``codes``, metres.
        codes: Ascending, at least one.
        leaf_size: An octant with more points is divided.
        edge: Of the cube that the codes refer to, metres.
    """
    top = split_nodes(codes, max(leaf_size, PART))
    roots = np.flatnonzero(top[:, 3] == 0)

    def build(first: int, last: int) -> list[np.ndarray]:
        return [split_nodes(codes[top[root, 0] : top[root, 1]], leaf_size) for root in roots[first:last]]

    parts = [part for found in map_blocks(build, len(roots), 1) for part in found]
    begins = len(top) + np.concatenate([[0], np.cumsum([len(part) - 1 for part in parts])])
    nodes = np.empty((begins[-1], 5), dtype=np.int32)
    boxes, cubes = np.empty((begins[-1], 6)), np.empty((begins[-1], 4))
    nodes[: len(top)] = top

    def bound(first: int, last: int) -> None:
        for at in range(first, last):
            _place_part(parts[at], nodes, roots[at], begins[at])
            bound_nodes(columns, codes, nodes, boxes, cubes, begins[at], begins[at + 1], edge)

    map_blocks(bound, len(roots), 1)
    bound_nodes(columns, codes, nodes, boxes, cubes, 0, len(top), edge)
    return Octants(nodes, boxes, cubes)


@njit(cache=True, nogil=True)
def split_nodes(codes, leaf_size):
    """Octants over sorted codes, breadth first: (start, stop, first child, children, level); chains are skipped."""
    n = codes.shape[0]
    capacity = 64
    nodes = np.empty((capacity, 5), dtype=np.int32)
    nodes[0] = (0, n, 0, 0, 0)
    count = 1
    current = 0
    while current < count:
        start, stop = nodes[current, 0], nodes[current, 1]
        differing = codes[start] ^ codes[stop - 1]
        level = BITS
        while differing != 0:
            differing >>= np.uint64(3)
            level -= 1
        nodes[current, 4] = level
        nodes[current, 2] = count
        if stop - start > leaf_size and level < BITS:
            if count + 8 > capacity:
                capacity *= 2
                grown = np.empty((capacity, 5), dtype=np.int32)
                grown[:count] = nodes[:count]
                nodes = grown
            shift = np.uint64(3 * (BITS - 1 - level))
            child_start = start
            while child_start < stop:
                digit = (codes[child_start] >> shift) & np.uint64(7)
                low, high = child_start, stop
                while low < high:
                    middle = (low + high) // 2
                    if ((codes[middle] >> shift) & np.uint64(7)) <= digit:
                        low = middle + 1
                    else:
                        high = middle
                nodes[count] = (child_start, low, 0, 0, 0)
                count += 1
                nodes[current, 3] += 1
                child_start = low
        current += 1
    return nodes[:count].copy()


@njit(cache=True, nogil=True)
def _place_part(part, nodes, root, begin):
    """Hang a part of the tree below its root: octants but the root from ``begin`` on, points from the root's start."""
    start = nodes[root, 0]
    nodes[root, 2], nodes[root, 3] = begin + part[0, 2] - 1, part[0, 3]
    for node in range(1, len(part)):
        to = begin + node - 1
        nodes[to, 0], nodes[to, 1] = start + part[node, 0], start + part[node, 1]
        nodes[to, 2] = begin + part[node, 2] - 1
        nodes[to, 3], nodes[to, 4] = part[node, 3], part[node, 4]


@njit(cache=True, nogil=True)
def bound_nodes(points, codes, nodes, boxes, cubes, begin, end, edge):
    """Boxes and cubes of the octants ``begin`` to ``end``, whose children outside of these are bounded already."""
    cell = edge / 2.0**BITS
    for node in range(end - 1, begin - 1, -1):
        start, stop, first, children, level = nodes[node]
        below = np.uint64(BITS - level)  # bits of a cell number that differ within the octant
        half = 2.0 ** (BITS - level - 1)
        cubes[node, 3] = half * cell
        for axis in range(3):
            low, high = np.inf, -np.inf
            if children == 0:
                for i in range(start, stop):
                    low = min(low, points[axis, i])
                    high = max(high, points[axis, i])
            else:
                for child in range(first, first + children):
                    low = min(low, boxes[child, axis])
                    high = max(high, boxes[child, axis + 3])
            boxes[node, axis], boxes[node, axis + 3] = low, high
            corner = (gather_bits(codes[start] >> np.uint64(axis)) >> below) << below
            cubes[node, axis] = (np.float64(corner) + half) * cell
