"""The loops of the octree. Positions are rows of the Morton-ordered copy of the points; all arithmetic is float64.

Boxes are the tight bounds of an octant's points, stored as (low xyz, high xyz). Rounding is monotone, so a squared
distance to a box bounds that to each of its points in floating point too, and no test needs a tolerance.
"""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN201, ANN202
import numpy as np
from numba import njit

from rm3d_plugin.ops.morton import BITS

SMALL_SORT = 40  # rows up to this length are sorted by insertion
STACK = 8 * (BITS + 2)  # at most seven waiting siblings on each level


@njit(cache=True, nogil=True)
def gather_columns(points, order, columns):
    """Coordinates in the given order, an axis a row."""
    for i in range(order.shape[0]):
        for axis in range(3):
            columns[axis, i] = points[order[i], axis]


@njit(cache=True, nogil=True, inline='always')
def _near_sq(boxes, node, x, y, z):
    dx = max(boxes[node, 0] - x, 0.0, x - boxes[node, 3])
    dy = max(boxes[node, 1] - y, 0.0, y - boxes[node, 4])
    dz = max(boxes[node, 2] - z, 0.0, z - boxes[node, 5])
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True, inline='always')
def _far_sq(boxes, node, x, y, z):
    dx = max(x - boxes[node, 0], boxes[node, 3] - x)
    dy = max(y - boxes[node, 1], boxes[node, 4] - y)
    dz = max(z - boxes[node, 2], boxes[node, 5] - z)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True, inline='always')
def _ball_inside(cubes, node, x, y, z, reach):
    """Whether the ball lies in the octant; x, y, z from the grid's corner."""
    room = cubes[node, 3] - reach
    return abs(x - cubes[node, 0]) <= room and abs(y - cubes[node, 1]) <= room and abs(z - cubes[node, 2]) <= room


@njit(cache=True, nogil=True)
def _sift_down(keys, values, base, root, count):
    """Restore a max-heap ordered by (key, value) in ``keys[base:base + count]``."""
    key, value = keys[base + root], values[base + root]
    while True:
        child = 2 * root + 1
        if child >= count:
            break
        right = child + 1
        if right < count and (
            keys[base + right] > keys[base + child]
            or (keys[base + right] == keys[base + child] and values[base + right] > values[base + child])
        ):
            child = right
        if keys[base + child] < key or (keys[base + child] == key and values[base + child] <= value):
            break
        keys[base + root], values[base + root] = keys[base + child], values[base + child]
        root = child
    keys[base + root], values[base + root] = key, value


@njit(cache=True, nogil=True)
def _unwind_heap(keys, values, base, count):
    """Turn a max-heap into ascending order."""
    for last in range(count - 1, 0, -1):
        keys[base], keys[base + last] = keys[base + last], keys[base]
        values[base], values[base + last] = values[base + last], values[base]
        _sift_down(keys, values, base, 0, last)


@njit(cache=True, nogil=True)
def sort_row(keys, values, base, count):
    """Sort a row by (key, value)."""
    if count > SMALL_SORT:
        for root in range(count // 2 - 1, -1, -1):
            _sift_down(keys, values, base, root, count)
        _unwind_heap(keys, values, base, count)
        return
    for i in range(base + 1, base + count):
        key, value = keys[i], values[i]
        j = i - 1
        while j >= base and (keys[j] > key or (keys[j] == key and values[j] > value)):
            keys[j + 1], values[j + 1] = keys[j], values[j]
            j -= 1
        keys[j + 1], values[j + 1] = key, value


@njit(cache=True, nogil=True)
def radius_block(tree, queries, rows, low, radii, margin, rules, ordered):
    """All points within ``radii`` of ``queries[rows]``: counts, indices, squared distances, visited octants."""
    points, order, nodes, boxes, cubes = tree
    skip_disjoint, stop_inside, take_contained = rules
    xs, ys, zs = points[0], points[1], points[2]
    counts = np.empty(rows.shape[0], dtype=np.int64)
    capacity = 64 * rows.shape[0] + 64
    indices = np.empty(capacity, dtype=np.int32)
    dists = np.empty(capacity, dtype=np.float64)
    stack = np.empty(STACK, dtype=np.int32)
    filled = 0
    visits = 0
    for row in range(rows.shape[0]):
        x, y, z = queries[rows[row], 0], queries[rows[row], 1], queries[rows[row], 2]
        local_x, local_y, local_z = x - low[0], y - low[1], z - low[2]
        radius = radii[rows[row]]
        limit = radius * radius
        begin = filled
        stack[0] = 0
        waiting = 1
        visits += 1
        while waiting > 0:
            waiting -= 1
            node = stack[waiting]
            start, stop, first, children = nodes[node, 0], nodes[node, 1], nodes[node, 2], nodes[node, 3]
            whole = take_contained and _far_sq(boxes, node, x, y, z) <= limit
            if children > 0 and not whole:
                for child in range(first, first + children):
                    visits += 1
                    if skip_disjoint and _near_sq(boxes, child, x, y, z) > limit:
                        continue
                    if stop_inside and _ball_inside(cubes, child, local_x, local_y, local_z, radius + margin):
                        stack[0], waiting = child, 1
                        break
                    stack[waiting] = child
                    waiting += 1
                continue
            if filled + stop - start >= capacity:
                capacity = max(2 * capacity, filled + stop - start + 1)
                grown_indices = np.empty(capacity, dtype=np.int32)
                grown_dists = np.empty(capacity, dtype=np.float64)
                grown_indices[:filled] = indices[:filled]
                grown_dists[:filled] = dists[:filled]
                indices, dists = grown_indices, grown_dists
            for i in range(start, stop):
                dx, dy, dz = xs[i] - x, ys[i] - y, zs[i] - z
                sq = dx * dx + dy * dy + dz * dz
                indices[filled] = order[i]
                dists[filled] = sq
                filled += whole or sq <= limit
        counts[row] = filled - begin
        if ordered:
            sort_row(dists, indices, begin, filled - begin)
    return counts, indices[:filled].copy(), dists[:filled].copy(), visits


@njit(cache=True, nogil=True)
def _keep_nearest(keys, values, found, k, sq, index):
    """Offer a point to the k nearest of ``found`` ones so far, a max-heap once there are k; how many there are now."""
    if found < k:
        keys[found], values[found] = sq, index
        if found + 1 == k:
            for root in range(k // 2 - 1, -1, -1):
                _sift_down(keys, values, 0, root, k)
        return found + 1
    if sq < keys[0] or (sq == keys[0] and index < values[0]):
        keys[0], values[0] = sq, index
        _sift_down(keys, values, 0, 0, k)
    return k


@njit(cache=True, nogil=True)
def nearest_row(tree, x, y, z, k, limit, stack, near, keys, values):
    """The k nearest points within ``sqrt(limit)`` of one query into ``keys`` and ``values``: how many, octants visited.

    ``stack`` and ``near`` hold the octants that wait and their squared distances.
    """
    points, order, nodes, boxes, _ = tree
    xs, ys, zs = points[0], points[1], points[2]
    found = visits = 0
    stack[0] = 0
    near[0] = _near_sq(boxes, 0, x, y, z)
    waiting = 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if near[waiting] > limit:
            continue
        visits += 1
        start, stop, first, children = nodes[node, 0], nodes[node, 1], nodes[node, 2], nodes[node, 3]
        if children > 0:
            base = waiting
            for child in range(first, first + children):
                sq = _near_sq(boxes, child, x, y, z)
                if sq > limit:
                    continue
                slot = waiting
                while slot > base and near[slot - 1] < sq:
                    near[slot], stack[slot] = near[slot - 1], stack[slot - 1]
                    slot -= 1
                near[slot], stack[slot] = sq, child
                waiting += 1
            continue
        for i in range(start, stop):
            dx, dy, dz = xs[i] - x, ys[i] - y, zs[i] - z
            sq = dx * dx + dy * dy + dz * dz
            if sq > limit:
                continue
            found = _keep_nearest(keys, values, found, k, sq, order[i])
            if found == k:
                limit = min(limit, keys[0])
    if found == k:
        _unwind_heap(keys, values, 0, k)
    else:
        sort_row(keys, values, 0, found)
    return found, visits


@njit(cache=True, nogil=True)
def scatter_rows(rows, offsets, counts, indices, dists, out_indices, out_dists):
    """Copy rows that follow each other to where their query's row belongs."""
    read = 0
    for row in range(rows.shape[0]):
        write = offsets[rows[row]]
        for i in range(counts[row]):
            out_indices[write + i] = indices[read + i]
            out_dists[write + i] = dists[read + i]
        read += counts[row]


@njit(cache=True, nogil=True)
def pack_rows(offsets, indices, dists, out_indices, out_dists):
    """Copy the filled heads of a table's rows into CSR."""
    for row in range(indices.shape[0]):
        to = offsets[row]
        for i in range(offsets[row + 1] - to):
            out_indices[to + i], out_dists[to + i] = indices[row, i], dists[row, i]
