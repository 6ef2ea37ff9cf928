"""Scenes seen again at test time, mirrored and turned: what a detector says of all looks together."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.decode import Detections, fuse_boxes
from rm3d_plugin.ops.boxes import nms_bev, rotated_iou_bev


class TtaView(NamedTuple):
    """How a scene is seen.

    Attributes:
        mirrored: y has the other sign, first.
        turn: Then it is turned about z by so much, radians.
    """

    mirrored: bool = False
    turn: float = 0.0


AS_SCANNED = TtaView()


def seen(batch: Batch, view: TtaView) -> Batch:
    """The batch as a view sees it."""
    if view == AS_SCANNED:
        return batch
    points = batch.points.clone()
    if view.mirrored:
        points[:, 1] = -points[:, 1]
    points[:, :2] = _turned(points[:, :2], view.turn)
    return batch._replace(points=points)


def as_scanned(found: Detections, view: TtaView) -> Detections:
    """Boxes that were found in a view, in the scene as it was scanned."""
    boxes = found.boxes.clone()
    boxes[:, :2] = _turned(boxes[:, :2], -view.turn)
    boxes[:, 6] -= view.turn
    if view.mirrored:
        boxes[:, [1, 6]] *= -1
    boxes[:, 6] = (boxes[:, 6] + math.pi).remainder(2 * math.pi) - math.pi
    return found._replace(boxes=boxes)


def _turned(xy: Float[Tensor, 'rows 2'], angle: float) -> Float[Tensor, 'rows 2']:
    cos, sin = math.cos(angle), math.sin(angle)
    return xy @ torch.tensor([[cos, sin], [-sin, cos]]).to(xy)


def pool_views(views: Sequence[Detections], nms_iou: float, fuse_iou: float | None, limit: int) -> Detections:
    """The boxes of all views as one set, in one frame: the best of boxes that overlap stays, with their mean score.

    Args:
        views: Boxes of the same scene, duplicates removed within each.
        nms_iou: Overlap from above that makes two boxes of a class duplicates. The score of a box is the mean over the
            views of the best score that its duplicates have there, 0 where there is none.
        fuse_iou: See :func:`~rm3d_plugin.models.heads.decode.fuse_boxes`; None keeps the best box as it is.
        limit: Most boxes a scene.
    """
    boxes, labels, scores = (torch.cat(column).cpu().numpy() for column in zip(*views, strict=True))
    boxes, scores = boxes.astype(np.float64), scores.astype(np.float64)
    view = np.repeat(np.arange(len(views)), [len(part.scores) for part in views])
    kept = nms_bev(boxes, scores, nms_iou, labels)
    if not len(kept):
        return views[0]
    same = (rotated_iou_bev(boxes[kept], boxes) > nms_iou) & (labels[kept][:, None] == labels[None])
    same[np.arange(len(kept)), kept] = True
    said = [np.where(same & (view == v), scores, 0.0).max(axis=1) for v in range(len(views))]
    chosen = boxes[kept] if fuse_iou is None else fuse_boxes(boxes, scores, labels, kept, fuse_iou)
    mean = np.mean(said, axis=0)
    order = np.argsort(-mean, kind='stable')[:limit]
    found = (chosen[order].astype(np.float32), labels[kept][order], mean[order].astype(np.float32))
    return Detections(*(torch.from_numpy(column) for column in found))
