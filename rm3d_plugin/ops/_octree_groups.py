"""Neighbours of queries that lie together: one descent for a group, then each query against the group's candidates.

Queries come along the Morton curve, so a run of them is a small patch. The octree is asked once for the points near the
patch's box; they are copied side by side, and each query measures them in a loop that compiles to vector instructions.
All arithmetic is float64 and that of a lone query, so both give the same numbers.
"""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN201, ANN202
import numpy as np
from numba import njit

from rm3d_plugin.ops._octree_kernels import STACK, nearest_row, sort_row

GROUP = 32  # queries that share a descent at most
SPREAD = 3.0  # a group's box is at most so many radii wide
CROWD = 64  # times k candidates: then the radius was guessed too large
MARGIN = 0.5  # over sqrt(k): by so much the guess for a group's radius exceeds that of the group before
RANKED = 128  # rows up to this length are sorted by counting what is smaller


@njit(cache=True, nogil=True)
def _next_group(queries, rows, first, stop, spread, box):
    """How many rows from ``first`` on share a box no wider than ``spread``; one row always does. Fills the box."""
    size = min(GROUP, stop - first)
    while True:
        widest = 0.0
        for axis in range(3):
            low = high = queries[rows[first], axis]
            for row in range(first + 1, first + size):
                low, high = min(low, queries[rows[row], axis]), max(high, queries[rows[row], axis])
            box[axis], box[axis + 3] = low, high
            widest = max(widest, high - low)
        if size == 1 or widest <= spread:
            return size
        size = (size + 1) // 2


@njit(cache=True, nogil=True)
def _near_ranges(tree, box, limit, stack, ranges):
    """Ranges of positions that hold all points within ``sqrt(limit)`` of the box: how many, points in them, visits."""
    nodes, boxes = tree[2], tree[3]
    stack[0] = 0
    waiting, count, total, visits = 1, 0, 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        start, stop, first, children = nodes[node, 0], nodes[node, 1], nodes[node, 2], nodes[node, 3]
        whole = children == 0
        if not whole:
            far = 0.0
            for axis in range(3):
                side = max(box[axis + 3] - boxes[node, axis], boxes[node, axis + 3] - box[axis])
                far += side * side
            whole = far <= limit
        if whole:
            total += stop - start
            if count > 0 and ranges[count - 1, 1] == start:
                ranges[count - 1, 1] = stop
            else:
                ranges[count, 0], ranges[count, 1] = start, stop
                count += 1
            continue
        for child in range(first + children - 1, first - 1, -1):
            visits += 1
            near = 0.0
            for axis in range(3):
                gap = max(boxes[child, axis] - box[axis + 3], box[axis] - boxes[child, axis + 3], 0.0)
                near += gap * gap
            stack[waiting] = child
            waiting += near <= limit
    return count, total, visits


@njit(cache=True, nogil=True)
def _copy_near(tree, box, limit, ranges, count, near, who):
    """Copy the points of the ranges within ``sqrt(limit)`` of the box; how many they are."""
    points, order = tree[0], tree[1]
    found = 0
    for at in range(count):
        for i in range(ranges[at, 0], ranges[at, 1]):
            x, y, z = points[0, i], points[1, i], points[2, i]
            gap_x = max(box[0] - x, x - box[3], 0.0)
            gap_y = max(box[1] - y, y - box[4], 0.0)
            gap_z = max(box[2] - z, z - box[5], 0.0)
            near[0, found], near[1, found], near[2, found] = x, y, z
            who[found] = order[i]
            found += gap_x * gap_x + gap_y * gap_y + gap_z * gap_z <= limit
    return found


@njit(cache=True, nogil=True)
def _measure(near, found, x, y, z, squares):
    """Squared distances to the candidates."""
    xs, ys, zs = near[0], near[1], near[2]
    for i in range(found):
        dx, dy, dz = xs[i] - x, ys[i] - y, zs[i] - z
        squares[i] = dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def _keep_within(who, squares, found, limit, row_who, row_squares):
    """Copy the candidates within ``sqrt(limit)``; how many they are."""
    kept = 0
    for i in range(found):
        square = squares[i]
        row_who[kept] = who[i]
        row_squares[kept] = square
        kept += square <= limit
    return kept


@njit(cache=True, nogil=True)
def _count_within(squares, found, limit):
    count = 0
    for i in range(found):
        count += squares[i] <= limit
    return count


@njit(cache=True, nogil=True)
def _write_sorted(row_who, row_squares, count, k, to, out_who, out_squares):
    """Write the k nearest of a row from ``to`` on, ascending by distance, then point number."""
    if count > RANKED:
        sort_row(row_squares, row_who, 0, count)
        for i in range(min(count, k)):
            out_who[to + i], out_squares[to + i] = row_who[i], row_squares[i]
        return
    distinct = 0
    for i in range(count):
        square, rank = row_squares[i], 0
        for j in range(count):
            rank += row_squares[j] < square
        distinct += rank
        if rank < k:
            out_who[to + rank], out_squares[to + rank] = row_who[i], square
    if distinct == count * (count - 1) // 2:
        return
    for i in range(count):  # equal distances: the point number decides
        square, index, rank = row_squares[i], row_who[i], 0
        for j in range(count):
            rank += (row_squares[j] < square) | ((row_squares[j] == square) & (row_who[j] < index))
        if rank < k:
            out_who[to + rank], out_squares[to + rank] = index, square


@njit(cache=True, nogil=True)
def _scratch(size):
    """Candidates as three columns of coordinates, their numbers and squared distances; those that a query keeps."""
    return np.empty((3, size)), np.empty(size, np.int32), np.empty(size), np.empty(size, np.int32), np.empty(size)


@njit(cache=True, nogil=True)
def _largest(radii, rows, first, size):
    """The largest radius of a group."""
    reach = 0.0
    for row in range(first, first + size):
        reach = max(reach, radii[rows[row]])
    return reach


@njit(cache=True, nogil=True)
def count_groups(tree, queries, rows, radii, counts):
    """Points within ``radii`` of ``queries[rows]``, into ``counts[rows]``; visited octants."""
    stack, ranges, box = np.empty(STACK, np.int32), np.empty((len(tree[2]), 2), np.int32), np.empty(6)
    near, who, squares, _, _ = _scratch(0)
    visits = first = 0
    while first < len(rows):
        size = _next_group(queries, rows, first, len(rows), SPREAD * radii[rows[first]], box)
        reach = _largest(radii, rows, first, size)
        spans, total, looked = _near_ranges(tree, box, reach * reach, stack, ranges)
        visits += looked
        if total >= len(who):
            near, who, squares, _, _ = _scratch(2 * total + 1)
        found = _copy_near(tree, box, reach * reach, ranges, spans, near, who)
        for row in range(first, first + size):
            query = rows[row]
            _measure(near, found, queries[query, 0], queries[query, 1], queries[query, 2], squares)
            counts[query] = _count_within(squares, found, radii[query] * radii[query])
        first += size
    return visits


@njit(cache=True, nogil=True)
def radius_groups(tree, queries, rows, radii, ordered):
    """All points within ``radii`` of ``queries[rows]``: counts, indices, squared distances, visited octants."""
    stack, ranges, box = np.empty(STACK, np.int32), np.empty((len(tree[2]), 2), np.int32), np.empty(6)
    near, who, squares, row_who, row_squares = _scratch(0)
    counts, capacity = np.empty(len(rows), np.int64), 64 * len(rows)
    indices, dists = np.empty(capacity, np.int32), np.empty(capacity)
    filled = visits = first = 0
    while first < len(rows):
        size = _next_group(queries, rows, first, len(rows), SPREAD * radii[rows[first]], box)
        reach = _largest(radii, rows, first, size)
        spans, total, looked = _near_ranges(tree, box, reach * reach, stack, ranges)
        visits += looked
        if total >= len(who):
            near, who, squares, row_who, row_squares = _scratch(2 * total + 1)
        found = _copy_near(tree, box, reach * reach, ranges, spans, near, who)
        if filled + size * found > capacity:
            capacity = 2 * (filled + size * found)
            more_indices, more_dists = np.empty(capacity, np.int32), np.empty(capacity)
            more_indices[:filled], more_dists[:filled] = indices[:filled], dists[:filled]
            indices, dists = more_indices, more_dists
        for row in range(first, first + size):
            query = rows[row]
            _measure(near, found, queries[query, 0], queries[query, 1], queries[query, 2], squares)
            kept = _keep_within(who, squares, found, radii[query] * radii[query], row_who, row_squares)
            if ordered:
                _write_sorted(row_who, row_squares, kept, kept, filled, indices, dists)
            else:
                for i in range(kept):
                    indices[filled + i], dists[filled + i] = row_who[i], row_squares[i]
            counts[row] = kept
            filled += kept
        first += size
    return counts, indices[:filled], dists[:filled], visits


@njit(cache=True, nogil=True)
def nearest_groups(tree, queries, rows, k, radii, counts, indices, dists):
    """The k nearest points within ``radii`` of ``queries[rows]``, into those rows of the outputs.

    The radius that held the k nearest of one group is the guess for the next; a query that finds fewer than k within
    the guess, though its radius is larger, is answered alone. Returns the visited octants.
    """
    stack, ranges, box = np.empty(STACK, np.int32), np.empty((len(tree[2]), 2), np.int32), np.empty(6)
    waiting_near = np.empty(STACK, np.float64)
    near, who, squares, row_who, row_squares = _scratch(0)
    flat_indices, flat_dists = indices.reshape(-1), dists.reshape(-1)
    width = indices.shape[1]
    guess = -1.0
    visits = first = 0
    while first < len(rows):
        alone = guess < 0.0
        size = 1 if alone else _next_group(queries, rows, first, len(rows), SPREAD * guess, box)
        reach = 0.0
        found = 0
        if not alone:
            reach = min(_largest(radii, rows, first, size), guess)
            spans, total, looked = _near_ranges(tree, box, reach * reach, stack, ranges)
            visits += looked
            alone = size == 1 or total > CROWD * (k + size)
        if alone:
            size = 1
        else:
            if total >= len(who):
                near, who, squares, row_who, row_squares = _scratch(2 * total + 1)
            found = _copy_near(tree, box, reach * reach, ranges, spans, near, who)
        farthest = 0.0
        for row in range(first, first + size):
            query = rows[row]
            x, y, z, limit = queries[query, 0], queries[query, 1], queries[query, 2], radii[query] * radii[query]
            kept = -1
            if not alone:
                _measure(near, found, x, y, z, squares)
                kept = _keep_within(who, squares, found, min(limit, reach * reach), row_who, row_squares)
                if kept < k and reach < radii[query]:
                    kept = -1
            if kept >= 0:
                _write_sorted(row_who, row_squares, kept, k, query * width, flat_indices, flat_dists)
                kept = min(kept, k)
            else:
                kept, looked = nearest_row(tree, x, y, z, k, limit, stack, waiting_near, dists[query], indices[query])
                visits += looked
            counts[query] = kept
            farthest = max(farthest, dists[query, kept - 1] if kept == k else limit)
        guess = (1.0 + MARGIN / np.sqrt(k)) * np.sqrt(farthest) if farthest > 0.0 else -1.0
        if not np.isfinite(guess):
            guess = -1.0
        first += size
    return visits
