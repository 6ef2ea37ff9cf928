"""Clusters of points that balls connect, and suppression of overlapping point masks (METHOD 7, instances)."""

# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: ANN001, ANN202
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from scipy.sparse import csr_matrix

_SHRINK = 1.0 - 1e-6  # a cell's diagonal stays below the radius whatever the rounding
_LARGEST = 2.0**62  # cells that an int64 can number


class PointMasks(NamedTuple):
    """Sets of points, in CSR.

    Attributes:
        indices: (E,) int64 point numbers, ascending within a mask; mask i is ``indices[offsets[i]:offsets[i + 1]]``.
        offsets: (K + 1,) int64.
    """

    indices: Int[np.ndarray, ' members']
    offsets: Int[np.ndarray, ' masks_and_one']

    @property
    def sizes(self) -> Int[np.ndarray, ' masks']:
        """Points of each mask."""
        return np.diff(self.offsets)


def masks_of(parts: list[Int[np.ndarray, ' _members']]) -> PointMasks:
    """Join the point numbers of each mask."""
    sizes = [len(part) for part in parts]
    indices = np.concatenate([np.zeros(0, dtype=np.int64), *parts]).astype(np.int64)
    return PointMasks(indices, np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64))


def ball_clusters(
    points: Float[np.ndarray, 'points 3'],
    radius: float,
    groups: Int[np.ndarray, ' points'] | None = None,
    min_points: int = 1,
) -> Int[np.ndarray, ' points']:
    """Clusters that a breadth-first search finds by stepping from point to point within a radius (METHOD 7).

    Two points of a group share a cluster where a chain of points of that group, each within ``radius`` (inclusive) of
    the next, leads from one to the other. The answer does not depend on any order or number of threads. Points are
    sorted into cells so small that those of a cell are connected, so many points in one place cost no more than few.

    Args:
        points: (N, 3) metres, finite.
        radius: Metres; larger: fewer, larger clusters.
        groups: Points are only connected within a group (a class of a scene, say); negative: the point takes no part.
            None: one group.
        min_points: Smaller clusters are dropped.

    Returns:
        (N,) int64 cluster of each point, numbered by their first points; -1 = none.

    Raises:
        ValueError: A coordinate is not finite, the radius is not positive or far too small for the cloud, or the rows
            of ``groups`` do not match.

    >>> line = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    >>> ball_clusters(line, radius=1.0).tolist()
    [0, 0, 1]
    >>> ball_clusters(line, radius=1.0, min_points=2).tolist()
    [0, 0, -1]
    """
    array = _checked(points, radius)
    keys = np.zeros(len(array), dtype=np.int64) if groups is None else np.asarray(groups, dtype=np.int64)
    if keys.shape != (len(array),):
        raise ValueError(f'ball_clusters: groups: expected shape ({len(array)},), one a point, got {keys.shape}')
    first = np.full(len(array), -1, dtype=np.int64)  # the lowest point of each point's cluster
    for key in np.unique(keys[keys >= 0]):
        rows = np.flatnonzero(keys == key)
        first[rows] = rows[_connected(array[rows], radius)]
    return _numbered(first, min_points)


def _checked(points: np.ndarray, radius: float) -> Float[np.ndarray, 'points 3']:
    given = np.asarray(points)
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f'ball_clusters: points: expected shape (N, 3), got {given.shape}')
    if not (np.isfinite(radius) and radius > 0):
        raise ValueError(f'ball_clusters: radius: expected metres > 0, got {radius}')
    array = np.ascontiguousarray(given, dtype=np.float64)
    bad = int((~np.isfinite(array).all(axis=1)).sum())
    if bad:
        raise ValueError(f'ball_clusters: points: {bad} of {len(array)} rows are NaN or infinite; drop them first')
    return array


def _connected(points: Float[np.ndarray, 'points 3'], radius: float) -> Int[np.ndarray, ' points']:
    """Lowest row of each point's connected component."""
    edge = radius / np.sqrt(3.0) * _SHRINK
    cells = np.floor((points - points.min(axis=0)) / edge)
    extent = cells.max(axis=0) + 5.0  # two empty cells beside each row: a code never runs over into the next row
    if extent.prod() >= _LARGEST:
        raise ValueError(
            f'ball_clusters: radius: {radius} m is too small for a cloud of {np.ptp(points, axis=0).max():.3g} m; '
            'drop stray points or use a larger radius'
        )
    x, y, z = cells.astype(np.int64).T
    step_y = int(extent[2])
    step_x = int(extent[1]) * step_y
    codes, inverse = np.unique(x * step_x + y * step_y + z, return_inverse=True)
    inverse = inverse.reshape(-1)
    order = np.argsort(inverse, kind='stable')
    starts = np.concatenate([[0], np.cumsum(np.bincount(inverse, minlength=len(codes)))])
    roots = _join_cells(points[order], starts, codes, step_x, step_y, radius * radius)[inverse]
    lowest = np.full(len(codes), len(points), dtype=np.int64)
    np.minimum.at(lowest, roots, np.arange(len(points)))
    return lowest[roots]


def _numbered(first: Int[np.ndarray, ' points'], min_points: int) -> Int[np.ndarray, ' points']:
    out = np.full(len(first), -1, dtype=np.int64)
    inside = first >= 0
    leaders, inverse, counts = np.unique(first[inside], return_inverse=True, return_counts=True)
    kept = counts >= min_points
    numbers = np.where(kept, np.cumsum(kept) - 1, -1)
    out[inside] = numbers[inverse.reshape(-1)] if len(leaders) else -1
    return out


@njit(cache=True, nogil=True)
def _root(parent, cell):
    while parent[cell] != cell:
        parent[cell] = parent[parent[cell]]
        cell = parent[cell]
    return cell


@njit(cache=True, nogil=True)
def _bounds(points, starts):
    """Lowest and highest coordinates of the points of each cell."""
    boxes = np.empty((len(starts) - 1, 6))
    for cell in range(len(boxes)):
        for axis in range(3):
            low = high = points[starts[cell], axis]
            for i in range(starts[cell] + 1, starts[cell + 1]):
                low, high = min(low, points[i, axis]), max(high, points[i, axis])
            boxes[cell, axis], boxes[cell, axis + 3] = low, high
    return boxes


@njit(cache=True, nogil=True)
def _box_far(box, x, y, z, square):
    """Whether a point lies further from a box than the radius; rounding is monotone, so no point is lost."""
    dx = max(box[0] - x, 0.0, x - box[3])
    dy = max(box[1] - y, 0.0, y - box[4])
    dz = max(box[2] - z, 0.0, z - box[5])
    return dx * dx + dy * dy + dz * dz > square


@njit(cache=True, nogil=True)
def _touch(points, starts, boxes, a, b, square):
    """Whether two cells hold points within the radius of each other."""
    for i in range(starts[a], starts[a + 1]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if _box_far(boxes[b], x, y, z, square):
            continue
        for j in range(starts[b], starts[b + 1]):
            dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            if dx * dx + dy * dy + dz * dz <= square:
                return True
    return False


@njit(cache=True, nogil=True)
def _join_cells(points, starts, codes, step_x, step_y, square):
    """Lowest cell that each cell is connected to; points within the radius lie at most two cells apart."""
    boxes = _bounds(points, starts)
    parent = np.arange(len(codes))
    for near in (1, 2):  # near cells first: they connect most, and what is connected needs no test
        for dx in range(near + 1):
            for dy in range(-near, near + 1):
                shift = dx * step_x + dy * step_y
                if shift < 0:
                    continue
                low = 0
                for cell in range(len(codes)):
                    wanted = codes[cell] + shift
                    while low < len(codes) and codes[low] < wanted - near:
                        low += 1
                    other = max(low, cell + 1)
                    while other < len(codes) and codes[other] <= wanted + near:
                        a, b = _root(parent, cell), _root(parent, other)
                        if a != b and _touch(points, starts, boxes, cell, other, square):
                            parent[max(a, b)] = min(a, b)
                        other += 1
    for cell in range(len(codes)):
        parent[cell] = _root(parent, cell)
    return parent


def cluster_masks(clusters: Int[np.ndarray, ' points']) -> PointMasks:
    """The points of each cluster of :func:`ball_clusters`."""
    count = int(clusters.max()) + 1 if len(clusters) else 0
    order = np.argsort(clusters, kind='stable')
    order = order[np.count_nonzero(clusters < 0) :]
    sizes = np.bincount(clusters[clusters >= 0], minlength=count)
    return PointMasks(order.astype(np.int64), np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64))


def mask_iou(masks: PointMasks, num_points: int) -> Float[np.ndarray, 'masks masks']:
    """Shared points over joint points of every two masks; 0 for two empty ones."""
    ones = np.ones(len(masks.indices), dtype=np.int64)
    table = csr_matrix((ones, masks.indices, masks.offsets), shape=(len(masks.offsets) - 1, num_points))
    shared = (table @ table.T).toarray()
    joint = masks.sizes[:, None] + masks.sizes[None] - shared
    out: Float[np.ndarray, 'masks masks'] = shared / np.maximum(joint, 1)
    return out


def mask_nms(
    masks: PointMasks, scores: Float[np.ndarray, ' masks'], num_points: int, iou: float
) -> Int[np.ndarray, ' kept']:
    """Masks that overlap no better one too much.

    Args:
        masks: Sets of points.
        scores: One a mask; higher is better, ties go to the mask that comes first.
        num_points: Points of the scene.
        iou: A mask that shares more than this with a better one that stays is dropped; 0.3 in METHOD 7.

    Returns:
        Numbers of the masks that stay, best first.
    """
    order = np.argsort(-np.asarray(scores, dtype=np.float64), kind='stable')
    overlap = mask_iou(masks, num_points) > iou
    dropped = np.zeros(len(order), dtype=bool)
    kept = []
    for mask in order:
        if not dropped[mask]:
            kept.append(mask)
            dropped |= overlap[mask]
    return np.array(kept, dtype=np.int64)
