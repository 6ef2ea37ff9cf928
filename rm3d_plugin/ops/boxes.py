"""Which box holds a point, how boxes overlap, which of several overlapping boxes stays.

Boxes are rows (x, y, z, dx, dy, dz, yaw): centre of gravity in metres (scene frame, z up), length along the heading,
width and height in metres, yaw in radians counter-clockwise from +x. All arithmetic is float64.
"""

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.ops.rotated_iou import (
    as_boxes,
    bev_iou,
    rotated_iou_3d,
    rotated_iou_bev,
    rotated_overlap_3d,
    rotated_overlap_bev,
)

__all__ = [
    'nms_bev',
    'points_in_boxes',
    'rotated_iou_3d',
    'rotated_iou_bev',
    'rotated_overlap_3d',
    'rotated_overlap_bev',
]


@njit(cache=True)
def _first_box(points: np.ndarray, boxes: np.ndarray, margin: float) -> np.ndarray:
    out = np.full(len(points), -1, dtype=np.int64)
    for j in range(len(boxes)):
        half_x = 0.5 * boxes[j, 3] + margin
        half_y = 0.5 * boxes[j, 4] + margin
        half_z = 0.5 * boxes[j, 5] + margin
        cos_yaw, sin_yaw = np.cos(boxes[j, 6]), np.sin(boxes[j, 6])
        for i in range(len(points)):
            if out[i] >= 0 or not abs(points[i, 2] - boxes[j, 2]) <= half_z:
                continue
            x = points[i, 0] - boxes[j, 0]
            y = points[i, 1] - boxes[j, 1]
            if abs(x * cos_yaw + y * sin_yaw) <= half_x and abs(y * cos_yaw - x * sin_yaw) <= half_y:
                out[i] = j
    return out


def points_in_boxes(
    points: Float[np.ndarray, 'points 3'], boxes: Float[np.ndarray, 'boxes 7'], margin: float = 0.0
) -> Int[np.ndarray, ' points']:
    """The first box that holds each point; the faces belong to the box.

    Args:
        points: (N, 3) metres; further columns are ignored. A point with a NaN lies in no box.
        boxes: (M, 7) rows.
        margin: Metres by which every face moves outwards; negative shrinks the boxes.

    Returns:
        (N,) int64 lowest index of a box that holds the point, -1 where none does.

    Raises:
        ValueError: The points have fewer than 3 columns, or a box is not valid.

    >>> points_in_boxes(np.array([[0., 0, 0], [3., 0, 0]]), np.array([[0., 0, 0, 4, 2, 1, 0]]))
    array([ 0, -1])
    """
    rows = np.ascontiguousarray(points, dtype=np.float64)
    if rows.size == 0:
        return np.full(len(rows), -1, dtype=np.int64)
    if rows.ndim != 2 or rows.shape[1] < 3:
        raise ValueError(f'points: expected shape (N, 3), got {rows.shape}')
    found: Int[np.ndarray, ' points'] = _first_box(rows, as_boxes('boxes', boxes), float(margin))
    return found


@njit(cache=True)
def _suppress(boxes: np.ndarray, order: np.ndarray, labels: np.ndarray, threshold: float) -> np.ndarray:
    alive = np.ones(len(boxes), dtype=np.bool_)
    kept = np.empty(len(boxes), dtype=np.int64)
    count = 0
    for rank in range(len(order)):
        i = order[rank]
        if not alive[i]:
            continue
        kept[count] = i
        count += 1
        for later in range(rank + 1, len(order)):
            j = order[later]
            if alive[j] and labels[i] == labels[j] and bev_iou(boxes[i], boxes[j]) > threshold:
                alive[j] = False
    return kept[:count]


def nms_bev(
    boxes: Float[np.ndarray, 'boxes 7'],
    scores: Float[np.ndarray, ' boxes'],
    threshold: float,
    labels: Int[np.ndarray, ' boxes'] | None = None,
) -> Int[np.ndarray, ' kept']:
    """Keep the best of the boxes that overlap, seen from above.

    Args:
        boxes: (M, 7) rows.
        scores: (M,) higher is better; equal scores: the lowest index first.
        threshold: A box goes when its IoU with a better kept box is above this. Smaller: fewer boxes stay.
        labels: (M,) classes; boxes of different classes do not compete. None: all compete.

    Returns:
        int64 indices of the kept boxes, by falling score.

    Raises:
        ValueError: Lengths differ, a score is NaN, or a box is not valid.

    >>> twice = np.array([[0., 0, 0, 4, 2, 1, 0]] * 2)
    >>> nms_bev(twice, np.array([.5, .9]), threshold=.25)
    array([1])
    """
    rows = as_boxes('boxes', boxes)
    values = np.asarray(scores, dtype=np.float64).reshape(-1)
    classes = np.zeros(len(rows), dtype=np.int64) if labels is None else np.asarray(labels, dtype=np.int64).reshape(-1)
    if not len(rows) == len(values) == len(classes):
        raise ValueError(f'nms_bev: {len(rows)} boxes, {len(values)} scores, {len(classes)} labels')
    if np.isnan(values).any():
        raise ValueError(f'nms_bev: {int(np.isnan(values).sum())} of {len(values)} scores are NaN')
    order = np.argsort(-values, kind='stable')
    kept: Int[np.ndarray, ' kept'] = _suppress(rows, order, classes, float(threshold))
    return kept
