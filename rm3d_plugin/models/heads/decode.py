"""From proposals to final boxes."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.heads.box_coder import BoxPrediction
from rm3d_plugin.ops.box_reach import box_reach
from rm3d_plugin.ops.boxes import nms_bev, points_in_boxes, rotated_iou_bev


class Detections(NamedTuple):
    """Boxes of one scene, best first.

    Attributes:
        boxes: (K, 7) float32.
        labels: (K,) int64.
        scores: (K,) float32 in [0, 1].
    """

    boxes: Float[Tensor, 'boxes 7']
    labels: Int[Tensor, ' boxes']
    scores: Float[Tensor, ' boxes']


def class_scores(
    prediction: BoxPrediction,
    group_probs: Float[Tensor, 'proposals classes'] | None = None,
    fits: Float[Tensor, ' proposals'] | None = None,
) -> Float[Tensor, 'proposals classes']:
    """Objectness times class probability, times the expected overlap where that is known.

    Args:
        prediction: Of the head.
        group_probs: Mean P_out of the points of each proposal, box classes only. Where given, the class probability is
            its geometric mean with what the points say.
        fits: Expected overlap of each box with its object, in [0, 1].
    """
    objectness = prediction.objectness.softmax(dim=1)[:, 1:]
    if fits is not None:
        objectness = objectness * fits[:, None]
    classes = prediction.class_scores.softmax(dim=1)
    if group_probs is None:
        return objectness * classes
    return objectness * (classes * group_probs.clamp(0.0, 1.0)).sqrt()


def fuse_boxes(
    boxes: Float[np.ndarray, 'boxes 7'],
    scores: Float[np.ndarray, ' boxes'],
    labels: Int[np.ndarray, ' boxes'],
    kept: Int[np.ndarray, ' kept'],
    iou: float,
) -> Float[np.ndarray, 'kept 7']:
    """Average each kept box with the boxes of its class that overlap it by more than ``iou``.

    Weights are score squared times overlap, so that doubtful boxes move little. Headings are averaged as lines: a box
    that points the other way supports the same outline, and the kept box tells front from back.

    Args:
        boxes: All boxes of a scene.
        scores: In [0, 1].
        labels: Classes.
        kept: Rows that the suppression kept.
        iou: Seen from above. Larger: fewer boxes are asked.
    """
    overlap = rotated_iou_bev(boxes[kept], boxes)
    weights = np.where((overlap > iou) & (labels[kept][:, None] == labels[None]), overlap * scores**2, 0.0)
    weights[np.arange(len(kept)), kept] = np.maximum(scores[kept] ** 2, 1e-12)
    weights /= weights.sum(axis=1, keepdims=True)
    turn = 2.0 * (boxes[None, :, 6] - boxes[kept, None, 6])
    shift = 0.5 * np.arctan2((weights * np.sin(turn)).sum(axis=1), (weights * np.cos(turn)).sum(axis=1))
    return np.concatenate([weights @ boxes[:, :6], (boxes[kept, 6] + shift)[:, None]], axis=1)


def select_boxes(
    boxes: Float[Tensor, 'proposals 7'],
    scores: Float[Tensor, 'proposals classes'],
    threshold: float,
    nms_iou: float,
    limit: int,
    fuse_iou: float | None = None,
) -> Detections:
    """Every proposal competes in every class; the best of boxes that overlap (seen from above) stays.

    Args:
        boxes: Decoded boxes of one scene.
        scores: Of each class.
        threshold: A lower score is dropped first.
        nms_iou: Overlap above which the lesser box goes (.25 in METHOD 7).
        limit: Most boxes a scene.
        fuse_iou: See :func:`fuse_boxes`; None keeps the best box as it is.
    """
    row, kind = (scores >= threshold).nonzero(as_tuple=True)
    score, box = scores[row, kind].double().cpu().numpy(), boxes[row].double().cpu().numpy()
    label = kind.cpu().numpy()
    kept = nms_bev(box, score, nms_iou, label)
    kept = kept[np.argsort(-score[kept], kind='stable')][:limit]
    chosen = box[kept] if fuse_iou is None or not len(kept) else fuse_boxes(box, score, label, kept, fuse_iou)
    return Detections(*(torch.from_numpy(v) for v in (chosen.astype(np.float32), label[kept], np.float32(score[kept]))))


def stand_on_ground(found: Detections, xyz: Float[Tensor, 'points 3'], height: Float[Tensor, ' points']) -> Detections:
    """The boxes moved up or down until they stand on the ground below the point that is nearest to each from above.

    Args:
        found: Boxes of one scene.
        xyz: Its points, metres, z up; without any, boxes stay.
        height: Metres of the points above the ground.
    """
    if not len(found.boxes) or not len(xyz):
        return found
    boxes, xyz, height = found.boxes.clone(), xyz.to(found.boxes), height.to(found.boxes)
    nearest = torch.cdist(boxes[:, :2], xyz[:, :2], compute_mode='donot_use_mm_for_euclid_dist').argmin(dim=1)
    boxes[:, 2] = xyz[nearest, 2] - height[nearest] + boxes[:, 5] / 2
    return found._replace(boxes=boxes)


def scored_by_height(found: Detections, xyz: Float[Tensor, 'points 3'], height: Float[Tensor, ' points']) -> Detections:
    """Scores times the share of its height that the points of a box reach above the ground, best first again.

    A box that claims more than is there is around something lower. What is higher by less than the widest gap in height
    between two of its points, or to the ground, may have been missed (:func:`~rm3d_plugin.ops.box_reach.box_reach`).

    Args:
        found: Boxes of one scene that stand on the ground.
        xyz: Its points, metres; up to where the lowest begin the ground is taken to have been dropped.
        height: Metres of the points above the ground.
    """
    boxes, places, up = (part.double().cpu().numpy() for part in (found.boxes, xyz, height))
    ground = max(float(up.min(initial=np.inf)), 0.0)
    share = np.zeros(len(boxes))
    for row in range(len(boxes)):
        own = up[points_in_boxes(places, boxes[row : row + 1]) >= 0]
        if len(own):
            reach = box_reach(own, np.zeros(len(own), dtype=np.int64), 1, ground)
            share[row] = (reach.top + reach.gap)[0] / max(boxes[row, 5], 1e-6)
    scores = found.scores * torch.from_numpy(share.clip(0.0, 1.0)).to(found.scores)
    order = torch.argsort(scores, descending=True, stable=True)
    return Detections(found.boxes[order], found.labels[order], scores[order])
