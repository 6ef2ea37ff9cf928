"""From proposals to final boxes."""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.heads.box_coder import BoxPrediction, decode_boxes
from rm3d_plugin.ops.boxes import nms_bev


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
    prediction: BoxPrediction, group_probs: Float[Tensor, 'proposals classes'] | None = None
) -> Float[Tensor, 'proposals classes']:
    """Objectness times class probability; with ``group_probs`` the class probability is averaged with what the
    grouped points say (geometric mean, renormalised).

    Args:
        prediction: Of the head.
        group_probs: Mean P_out of the points of each proposal, box classes only.
    """  # noqa: D205
    objectness = prediction.objectness.softmax(dim=1)[:, 1:]
    classes = prediction.class_scores.softmax(dim=1)
    if group_probs is None:
        return objectness * classes
    return objectness * (classes * group_probs.clamp(0.0, 1.0)).sqrt()


def select_boxes(
    boxes: Float[Tensor, 'proposals 7'],
    scores: Float[Tensor, 'proposals classes'],
    threshold: float,
    nms_iou: float,
    limit: int,
) -> Detections:
    """Every proposal competes in every class; the best of boxes that overlap (seen from above) stays.

    Args:
        boxes: Decoded boxes of one scene.
        scores: Of each class.
        threshold: A lower score is dropped first.
        nms_iou: Overlap above which the lesser box goes (.25 in METHOD 7).
        limit: Most boxes a scene.
    """
    row, label = (scores >= threshold).nonzero(as_tuple=True)
    score, box = scores[row, label].cpu(), boxes[row].cpu()
    label = label.cpu()
    kept = nms_bev(box.double().numpy(), score.double().numpy(), nms_iou, label.numpy())
    kept = kept[np.argsort(-score.numpy()[kept], kind='stable')][:limit]
    index = torch.from_numpy(kept)
    return Detections(box[index].float(), label[index], score[index].float())


def decode_scene(
    prediction: BoxPrediction,
    mean_sizes: Float[Tensor, 'classes 3'],
    group_probs: Float[Tensor, 'proposals classes'] | None = None,
    threshold: float = 0.05,
    nms_iou: float = 0.25,
    limit: int = 100,
) -> Detections:
    """Boxes of one scene from its proposals."""
    boxes = decode_boxes(prediction, mean_sizes)
    return select_boxes(boxes, class_scores(prediction, group_probs), threshold, nms_iou, limit)
