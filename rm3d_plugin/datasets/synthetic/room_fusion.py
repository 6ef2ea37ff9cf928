"""From depth images to one scan: a point per voxel, a triangle mesh over them, and small segments of the mesh."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.datasets.synthetic.room_scanner import Shots
from rm3d_plugin.datasets.synthetic.room_smoothing import smooth_surface

MOST_FACES = 8  # triangles at one point


class Fused(NamedTuple):
    """A fused scan, ordered by voxel (x, then y, then z).

    Attributes:
        xyz: (N, 3) metres, mean of the pixels that fell into a voxel and show the thing that most of them show.
        colors: (N, 3) in [0, 1], mean of the same.
        normals: (N, 3) unit normals, mean of the same.
        thing: (N,) number of the thing, ties to the lowest.
        face: (N,) a triangle of the room that the point was measured on.
        point: (P,) the point that each pixel went into.
    """

    xyz: Float[np.ndarray, 'points 3']
    colors: Float[np.ndarray, 'points 3']
    normals: Float[np.ndarray, 'points 3']
    thing: Int[np.ndarray, ' points']
    face: Int[np.ndarray, ' points']
    point: Int[np.ndarray, ' pixels']


def fuse(shots: Shots, spacing: float) -> Fused:
    """One point per voxel of ``spacing`` metres.

    Raises:
        ValueError: No pixel measured anything.
    """
    if len(shots.xyz) == 0:
        raise ValueError('fuse: expected at least one pixel that measured something, got none')
    low = np.floor(shots.xyz.min(axis=0) / spacing)
    cell = (np.floor(shots.xyz / spacing) - low).astype(np.int64)
    sizes = cell.max(axis=0) + 1
    key = (cell[:, 0] * sizes[1] + cell[:, 1]) * sizes[2] + cell[:, 2]
    order = np.lexsort((shots.thing, key))
    values = np.concatenate([shots.xyz, shots.colors, shots.normals], axis=1)
    mean, thing, face, point = _average(order, key, shots.thing, shots.face, values)
    normals = mean[:, 6:]
    length = np.sqrt(normals[:, 0] ** 2 + normals[:, 1] ** 2 + normals[:, 2] ** 2)
    # Two sides of a thin sheet in one voxel may cancel out.
    normals = np.where(length[:, None] > 1e-6, normals / np.maximum(length, 1e-6)[:, None], np.array([0.0, 0.0, 1.0]))
    return Fused(mean[:, :3], mean[:, 3:6], normals, thing, face, point)


def smoothed(fused: Fused, spacing: float) -> Fused:
    """The same points as a volume of signed distances has them: on one round surface, their colours run."""
    weight = np.bincount(fused.point, minlength=len(fused.xyz)).astype(np.float64)
    xyz, normals, colors = smooth_surface(fused.xyz, fused.normals, fused.colors, weight, spacing)
    return fused._replace(xyz=xyz, normals=normals, colors=colors)


@njit(cache=True)
def _average(order: Any, key: Any, thing: Any, face: Any, values: Any) -> Any:
    """Runs of one voxel, and in them runs of one thing; the longest run of a voxel makes its point."""
    count = 0
    for i in range(order.shape[0]):
        if i == 0 or key[order[i]] != key[order[i - 1]]:
            count += 1
    mean = np.zeros((count, values.shape[1]))
    owner = np.empty(count, dtype=np.int64)
    seen = np.empty(count, dtype=np.int64)
    point = np.empty(order.shape[0], dtype=np.int64)
    at, i = -1, 0
    while i < order.shape[0]:
        at += 1
        voxel = key[order[i]]
        best_start, best_end = i, i
        while i < order.shape[0] and key[order[i]] == voxel:
            start, number = i, thing[order[i]]
            while i < order.shape[0] and key[order[i]] == voxel and thing[order[i]] == number:
                point[order[i]] = at
                i += 1
            if i - start > best_end - best_start:
                best_start, best_end = start, i
        for k in range(best_start, best_end):
            for c in range(values.shape[1]):
                mean[at, c] += values[order[k], c]
        for c in range(values.shape[1]):
            mean[at, c] /= best_end - best_start
        owner[at] = thing[order[best_start]]
        seen[at] = face[order[best_start]]
    return mean, owner, seen, point


def mesh_faces(fused: Fused, shots: Shots, longest: float) -> Int[np.ndarray, 'faces 3']:
    """Triangles between the points of neighbouring pixels, facing the camera; none twice, few at one point.

    Args:
        fused: The points.
        shots: The images they come from.
        longest: Longest edge in metres.
    """
    return _triangles(fused.point, fused.xyz, shots.pixel, *shots.shape, longest)


@njit(cache=True)
def _triangles(point: Any, xyz: Any, pixel: Any, images: int, rows: int, columns: int, longest: float) -> Any:
    count = xyz.shape[0]
    faces = np.empty((count * MOST_FACES // 3 + 1, 3), dtype=np.int32)
    degree = np.zeros(count, dtype=np.int64)
    around = np.full((count, MOST_FACES), -1, dtype=np.int32)
    grid = np.empty(rows * columns, dtype=np.int64)
    total, at = 0, 0
    for image in range(images):
        grid[:] = -1
        while at < pixel.shape[0] and pixel[at] < (image + 1) * rows * columns:
            grid[pixel[at] - image * rows * columns] = point[at]
            at += 1
        for r in range(rows - 1):
            for c in range(columns - 1):
                p, q = grid[r * columns + c], grid[r * columns + c + 1]
                s, t = grid[(r + 1) * columns + c], grid[(r + 1) * columns + c + 1]
                for half in range(2):
                    x, y, z = (p, s, q) if half == 0 else (q, s, t)
                    if not _allowed(x, y, z, xyz, degree, around, faces, longest):
                        continue
                    faces[total, 0], faces[total, 1], faces[total, 2] = x, y, z
                    for corner in (x, y, z):
                        around[corner, degree[corner]] = total
                        degree[corner] += 1
                    total += 1
    return faces[:total].copy()


@njit(cache=True)
def _allowed(x: int, y: int, z: int, xyz: Any, degree: Any, around: Any, faces: Any, longest: float) -> Any:
    """Whether a triangle is proper, short enough, new, and its points have room for it."""
    if x < 0 or y < 0 or z < 0 or x == y or y == z or x == z:
        return False
    if degree[x] >= MOST_FACES or degree[y] >= MOST_FACES or degree[z] >= MOST_FACES:
        return False
    for a, b in ((x, y), (y, z), (z, x)):
        dx, dy, dz = xyz[a, 0] - xyz[b, 0], xyz[a, 1] - xyz[b, 1], xyz[a, 2] - xyz[b, 2]
        if dx * dx + dy * dy + dz * dz > longest * longest:
            return False
    for k in range(degree[x]):
        f = around[x, k]
        same = 0
        for i in range(3):
            if faces[f, i] == x or faces[f, i] == y or faces[f, i] == z:
                same += 1
        if same == 3:
            return False
    return True


def mesh_segments(
    faces: Int[np.ndarray, 'faces 3'],
    normals: Float[np.ndarray, 'points 3'],
    colors: Float[np.ndarray, 'points 3'],
    thing: Int[np.ndarray, ' points'],
    threshold: float = 0.08,
    least: int = 20,
) -> Int[np.ndarray, ' points']:
    """Small segments of a mesh, as ScanNet has them: Felzenszwalb and Huttenlocher's graph segmentation (2004).

    An edge weighs 1 - cosine of its points' normals, plus a share of their difference in colour.
    No segment crosses a border of ``thing``.

    Args:
        faces: Triangles.
        normals: Unit normals.
        colors: In [0, 1].
        thing: Number of the part of the scan that each point is in; zeros: segments follow the mesh alone.
        threshold: Larger: larger segments.
        least: Segments of fewer points join a neighbour where they have one.

    Returns:
        Segment of each point, numbered by first point.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    edges = edges[thing[edges[:, 0]] == thing[edges[:, 1]]]
    a, b = edges[:, 0], edges[:, 1]
    cosine = normals[a, 0] * normals[b, 0] + normals[a, 1] * normals[b, 1] + normals[a, 2] * normals[b, 2]
    step = np.abs(colors[a] - colors[b]).max(axis=1)
    weight = np.round(1 - cosine + 0.3 * step, 9)
    order = np.argsort(weight, kind='stable')
    root = _join_edges(edges[order], weight[order], len(thing), threshold, least)
    _, first, inverse = np.unique(root, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


@njit(cache=True)
def _find(parent: Any, i: int) -> Any:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def _join_edges(edges: Any, weight: Any, count: int, threshold: float, least: int) -> Any:
    parent, size = np.arange(count), np.ones(count, dtype=np.int64)
    limit = np.full(count, threshold)
    for rounds in range(2):
        for e in range(edges.shape[0]):
            a, b = _find(parent, edges[e, 0]), _find(parent, edges[e, 1])
            if a == b:
                continue
            small = min(size[a], size[b]) < least
            if (rounds == 0 and weight[e] <= min(limit[a], limit[b])) or (rounds == 1 and small):
                low, high = min(a, b), max(a, b)
                parent[high] = low
                size[low] += size[high]
                limit[low] = weight[e] + threshold / size[low]
    for i in range(count):
        parent[i] = _find(parent, i)
    return parent
