"""Pseudo boxes: from the points of a group to a whole object (METHOD 7)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.rotated_iou import rotated_iou_bev
from rm3d_plugin.pseudo_labels.detection.box_fit import fit_footprint
from rm3d_plugin.structures import Boxes3D, Regions

MAX_EXCESS = 1.35  # a group larger than this times its class's size is not one object; METHOD 7
EXCESS_SLACK = 0.1  # m; measurement noise on top
MIN_SIZE = 0.05  # m; a flat group still has a box


class BoxFit(NamedTuple):
    """A completed box and how well it fits.

    Attributes:
        box: (7,) row as :class:`Boxes3D`.
        span: (3,) extents of the points along the box's axes, metres.
        cost: Mean distance of the points to the visible faces plus penalties, metres.
    """

    box: Float[np.ndarray, '7']
    span: Float[np.ndarray, '3']
    cost: float


def median_sizes(
    boxes: Float[np.ndarray, 'boxes 7'], labels: Int[np.ndarray, ' boxes'], num_classes: int
) -> Float[np.ndarray, 'classes 3']:
    """Median (dx, dy, dz) of the labelled boxes of each class, metres; NaN for a class without any."""
    priors = np.full((num_classes, 3), np.nan)
    for c in range(num_classes):
        if (labels == c).any():
            priors[c] = np.median(np.asarray(boxes)[labels == c, 3:6], axis=0)
    return priors


def size_ranges(
    boxes: Float[np.ndarray, 'boxes 7'], labels: Int[np.ndarray, ' boxes'], mean_sizes: Float[np.ndarray, 'classes 3']
) -> Float[np.ndarray, 'classes 2 3']:
    """Least and greatest longer side, shorter side and height of the labelled boxes of each class, metres.

    Args:
        boxes: Labelled boxes.
        labels: Their classes.
        mean_sizes: For classes without any; NaN stays NaN.
    """
    ranges = np.repeat(_sides(mean_sizes)[:, None], 2, axis=1)
    for c in np.unique(labels).tolist():
        own = _sides(np.asarray(boxes)[labels == c, 3:6])
        ranges[c] = own.min(axis=0), own.max(axis=0)
    return ranges


def _sides(sizes: Float[np.ndarray, 'boxes 3']) -> Float[np.ndarray, 'boxes 3']:
    """Longer side, shorter side, height: which side is the length is a matter of yaw."""
    return np.concatenate([-np.sort(-sizes[:, :2], axis=1), sizes[:, 2:]], axis=1)


def has_usual_size(
    boxes: Boxes3D, ranges: Float[np.ndarray, 'classes 2 3'], ratio: float
) -> Bool[np.ndarray, ' boxes']:
    """Whether both sides and the height lie in the range of the class, widened by a factor; never where it is NaN."""
    sides, own = _sides(boxes.tensor[:, 3:6]), ranges[boxes.labels]
    return np.asarray(((sides >= own[:, 0] / ratio) & (sides <= own[:, 1] * ratio)).all(axis=1))


def tight_box(
    points: Float[np.ndarray, 'points 3'], yaw_fitted: bool = True, sensor: tuple[float, float] | None = (0.0, 0.0)
) -> Float[np.ndarray, '7']:
    """The smallest upright box around the points, axis-aligned (as printed) or turned to fit their sides.

    A turned box leaves out a few strays (see :func:`fit_footprint`).

    Args:
        points: (N, 3) metres, at least one.
        yaw_fitted: Search the angle whose rectangle hugs the points; else the axes are the scene's.
        sensor: Where the points were seen from, metres; its side counts in the search for the angle. None: see
            :func:`fit_footprint`.
    """
    points = np.asarray(points, dtype=np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    if not yaw_fitted:
        return np.concatenate([(low + high) / 2, np.maximum(high - low, MIN_SIZE), [0.0]])
    footprint = fit_footprint(points[:, :2], (0.0, 0.0), sensor)
    size, yaw = footprint.size, footprint.yaw
    if size[0] < size[1]:
        size, yaw = size[::-1], (yaw + np.pi) % np.pi - np.pi / 2
    middle, height = (low[2] + high[2]) / 2, high[2] - low[2]
    return np.array([*footprint.center, middle, *np.maximum([*size, height], MIN_SIZE), yaw])


def complete_box(
    points: Float[np.ndarray, 'points 3'],
    prior: Float[np.ndarray, '3'],
    ground_z: float | None = None,
    sensor: tuple[float, float] | None = (0.0, 0.0),
) -> BoxFit:
    """The whole object behind the faces that the sensor saw.

    From above, a rectangle of the class's size touches the points on the sensor's side and extends away from it. It
    stands on the ground and is as high as usual, or higher where the points are.

    Args:
        points: (N, 3) metres, at least one, without ground.
        prior: (dx, dy, dz) of the class, metres.
        ground_z: Height of the ground under the object, metres; None: the lowest point.
        sensor: Position of the sensor from above, metres; None: see :func:`fit_footprint`.
    """
    points = np.asarray(points, dtype=np.float64)
    footprint = fit_footprint(points[:, :2], (float(prior[0]), float(prior[1])), sensor)
    low, high = points[:, 2].min(), points[:, 2].max()
    bottom = low if ground_z is None else min(ground_z, low)
    height = max(high - bottom, float(prior[2]))  # the top ring may pass under the top, never over it
    box = np.array([*footprint.center, bottom + height / 2, *footprint.size, height, footprint.yaw])
    return BoxFit(box, np.array([*footprint.span, high - low]), footprint.cost)


def is_plausible(fit: BoxFit, prior: Float[np.ndarray, '3'], max_excess: float = MAX_EXCESS) -> bool:
    """Whether the points of a group are not larger than its class allows; the two horizontal axes may swap."""
    limit = max_excess * prior + EXCESS_SLACK
    horizontal = np.sort(fit.span[:2]) <= np.sort(limit[:2])
    return bool(horizontal.all() and fit.box[5] <= limit[2])


def robust_extents(xyz: Float[np.ndarray, 'points 3'], regions: Regions) -> Float[np.ndarray, 'regions 3']:
    """Extents of each region along its principal axes, metres, longest first, whatever a tenth of its points does.

    The middle four fifths along each axis, stretched to the whole: exact for points spread evenly.
    """
    out = np.zeros((len(regions), 3))
    for r in range(len(regions)):
        points = xyz[regions.points_of(r)].astype(np.float64)
        points -= np.median(points, axis=0)
        _, axes = np.linalg.eigh(points.T @ points)
        low, high = np.quantile(points @ axes, (0.1, 0.9), axis=0)
        out[r] = np.sort((high - low) / 0.8)[::-1]
    return out


def region_tops(height: Float[np.ndarray, ' points'], regions: Regions) -> Float[np.ndarray, ' regions']:
    """How high each region reaches above the ground, metres: the height that a tenth of its points exceeds."""
    return np.array([np.quantile(height[regions.points_of(r)], 0.9) for r in range(len(regions))], dtype=np.float64)


def geometric_background(
    extents: Float[np.ndarray, 'regions 3'],
    heights: Float[np.ndarray, ' regions'] | None,
    priors: Float[np.ndarray, 'classes 3'],
    ratio: float = 1.5,
) -> Bool[np.ndarray, ' regions']:
    """Regions that no object class can be: much larger, or reaching much higher above ground, than any of them.

    Args:
        extents: Extents of each region, metres, longest first.
        heights: How high each region reaches above the ground, metres; None where the ground is unknown.
        priors: Sizes of the object classes; NaN rows are ignored, and if there is no other nothing is background.
        ratio: How much larger than the usual size still passes; larger: less background.
    """
    known = priors[np.isfinite(priors).all(axis=1)]
    if len(known) == 0:
        return np.zeros(len(extents), dtype=bool)
    # Principal axes of an L of two faces are its diagonals, so the longest extent may reach the box's diagonal.
    diagonal = np.linalg.norm(known[:, :2], axis=1)
    limits = np.sort(known, axis=1)[:, ::-1].copy()
    limits[:, 0] = np.maximum(limits[:, 0], diagonal)
    within = np.all(extents[:, None, :] <= ratio * limits[None], axis=2)
    fits = np.any(within, axis=1)
    if heights is not None:
        fits &= heights <= ratio * known[:, 2].max()
    return np.asarray(~fits)


def suppress(
    boxes: Boxes3D, priority: Float[np.ndarray, ' boxes'], annotated: Boxes3D, max_iou: float = 0.1
) -> Int[np.ndarray, ' boxes']:
    """Which box each box gives way to: an annotated box that it overlaps, else a better kept one.

    Args:
        boxes: Pseudo boxes.
        priority: Larger is better; equal: the lower index wins.
        annotated: Annotated boxes, which always win.
        max_iou: Overlap from above that two objects may have.

    Returns:
        (M,) int64: its own index if the box is kept, -1 if an annotated box takes its place, else the index of the
        winner.
    """
    winner = np.arange(len(boxes), dtype=np.int64)
    if len(boxes) == 0:
        return winner
    if len(annotated):
        tall = np.array(annotated.tensor)
        tall[:, 5] = 1e3  # m; a centre above or below counts as inside
        inside = points_in_boxes(boxes.tensor[:, :3], tall) >= 0
        winner[inside | (rotated_iou_bev(boxes.tensor, annotated.tensor).max(axis=1) > max_iou)] = -1
    overlap = rotated_iou_bev(boxes.tensor, boxes.tensor) > max_iou
    order = np.argsort(-priority, kind='stable')
    for rank, i in enumerate(order):
        if winner[i] == i:
            worse = order[rank + 1 :]
            winner[worse[overlap[i, worse] & (winner[worse] == worse)]] = i
    return winner
