"""Overlap of upright boxes that turn about z, by polygon clipping (float64)."""

import numpy as np
from jaxtyping import Float
from numba import njit


def as_boxes(name: str, boxes: np.ndarray) -> Float[np.ndarray, 'boxes 7']:
    """The rows as contiguous float64.

    Raises:
        ValueError: The shape is not (M, 7), a number is not finite, or a size is negative.
    """
    rows = np.ascontiguousarray(boxes, dtype=np.float64)
    if rows.size == 0:
        return np.zeros((0, 7))
    if rows.ndim != 2 or rows.shape[1] != 7:
        raise ValueError(f'{name}: expected rows (x, y, z, dx, dy, dz, yaw) of shape (M, 7), got {rows.shape}')
    bad = int((~np.isfinite(rows).all(axis=1)).sum())
    if bad:
        raise ValueError(f'{name}: {bad} of {len(rows)} boxes hold a NaN or infinite number; drop them first')
    if rows[:, 3:6].min() < 0:
        raise ValueError(f'{name}: sizes must not be negative, got {rows[:, 3:6].min()}')
    return rows


@njit(cache=True)
def _clip(polygon: np.ndarray, count: int, clipped: np.ndarray, axis: int, sign: float, limit: float) -> int:
    """Cut a convex polygon at ``sign * coordinate <= limit`` (one step of Sutherland and Hodgman)."""
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here = limit - sign * polygon[i, axis]
        there = limit - sign * polygon[j, axis]
        if here >= 0.0:
            clipped[kept] = polygon[i]
            kept += 1
        if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
            share = here / (here - there)
            other = 1 - axis
            clipped[kept, other] = polygon[i, other] + share * (polygon[j, other] - polygon[i, other])
            clipped[kept, axis] = sign * limit
            kept += 1
    return kept


@njit(cache=True)
def bev_overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Area in square metres that two boxes (7,) share when seen from above.

    The first rectangle is moved into the frame of the second, where clipping needs comparisons with constants only;
    so equal boxes share exactly their area and boxes that merely touch share exactly nothing.
    """
    x = a[0] - b[0]
    y = a[1] - b[1]
    reach = 0.5 * (np.hypot(a[3], a[4]) + np.hypot(b[3], b[4]))
    if x * x + y * y > reach * reach:
        return 0.0
    cos_b, sin_b = np.cos(b[6]), np.sin(b[6])
    centre_x = x * cos_b + y * sin_b
    centre_y = y * cos_b - x * sin_b
    turn = a[6] - b[6]
    cos_t, sin_t = np.cos(turn), np.sin(turn)
    polygon = np.empty((8, 2))
    clipped = np.empty((8, 2))
    for corner in range(4):
        u = 0.5 * a[3] if corner == 0 or corner == 3 else -0.5 * a[3]
        v = 0.5 * a[4] if corner < 2 else -0.5 * a[4]
        polygon[corner, 0] = centre_x + u * cos_t - v * sin_t
        polygon[corner, 1] = centre_y + u * sin_t + v * cos_t
    count = 4
    for side in range(4):
        axis = side // 2
        sign = 1.0 if side % 2 == 0 else -1.0
        count = _clip(polygon, count, clipped, axis, sign, 0.5 * b[3 + axis])
        polygon, clipped = clipped, polygon
    area = 0.0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        area += polygon[i, 0] * polygon[j, 1] - polygon[j, 0] * polygon[i, 1]
    return min(max(0.5 * area, 0.0), a[3] * a[4], b[3] * b[4])


@njit(cache=True)
def bev_iou(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two boxes (7,) seen from above; 0 where both have no area."""
    shared = bev_overlap(a, b)
    union = a[3] * a[4] + b[3] * b[4] - shared
    return shared / union if union > 0.0 else 0.0


@njit(cache=True)
def _pairwise_overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    out = np.zeros((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            out[i, j] = bev_overlap(a[i], b[j])
    return out


def _ratio(
    shared: Float[np.ndarray, 'a b'], size_a: Float[np.ndarray, ' a'], size_b: Float[np.ndarray, ' b']
) -> Float[np.ndarray, 'a b']:
    union = size_a[:, None] + size_b[None, :] - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)


def rotated_overlap_bev(a: Float[np.ndarray, 'a 7'], b: Float[np.ndarray, 'b 7']) -> Float[np.ndarray, 'a b']:
    """Shared area in square metres of each pair of boxes, seen from above."""
    overlap: Float[np.ndarray, 'a b'] = _pairwise_overlap(as_boxes('a', a), as_boxes('b', b))
    return overlap


def rotated_overlap_3d(a: Float[np.ndarray, 'a 7'], b: Float[np.ndarray, 'b 7']) -> Float[np.ndarray, 'a b']:
    """Shared volume in cubic metres of each pair of boxes."""
    a, b = as_boxes('a', a), as_boxes('b', b)
    top = np.minimum((a[:, 2] + a[:, 5] / 2)[:, None], (b[:, 2] + b[:, 5] / 2)[None, :])
    bottom = np.maximum((a[:, 2] - a[:, 5] / 2)[:, None], (b[:, 2] - b[:, 5] / 2)[None, :])
    height = np.minimum(np.maximum(top - bottom, 0.0), np.minimum(a[:, 5][:, None], b[:, 5][None, :]))
    return rotated_overlap_bev(a, b) * height


def rotated_iou_bev(a: Float[np.ndarray, 'a 7'], b: Float[np.ndarray, 'b 7']) -> Float[np.ndarray, 'a b']:
    """Intersection over union of each pair, seen from above (rows (x, y, z, dx, dy, dz, yaw), metres and radians).

    Args:
        a: (M, 7) boxes.
        b: (K, 7) boxes.

    Returns:
        (M, K) float64 in [0, 1]; 0 where neither box has an area.

    Raises:
        ValueError: A row is not finite, a size is negative, or the shape is not (M, 7).

    >>> car = np.array([[0., 0, 0, 4, 2, 1.5, 0]])
    >>> rotated_iou_bev(car, car + [2, 0, 0, 0, 0, 0, 0]).round(3)
    array([[0.333]])
    """
    a, b = as_boxes('a', a), as_boxes('b', b)
    return _ratio(rotated_overlap_bev(a, b), a[:, 3] * a[:, 4], b[:, 3] * b[:, 4])


def rotated_iou_3d(a: Float[np.ndarray, 'a 7'], b: Float[np.ndarray, 'b 7']) -> Float[np.ndarray, 'a b']:
    """Intersection over union by volume of each pair of boxes; arguments and errors as :func:`rotated_iou_bev`."""
    a, b = as_boxes('a', a), as_boxes('b', b)
    return _ratio(rotated_overlap_3d(a, b), a[:, 3:6].prod(axis=1), b[:, 3:6].prod(axis=1))
