"""A second look at a scene, mirrored left and right: what both looks agree on is more likely true."""

import copy
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from rm3d_plugin.engine.scene_prediction import scene_prediction
from rm3d_plugin.ops.boxes import rotated_iou_3d
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.structures import Boxes3D, SceneError

LEAST_IOU = 0.1  # overlap by volume from which two boxes are one object seen twice


def mirrored_batch(batch: dict[str, Any]) -> dict[str, Any]:
    """The same scenes with y of the other sign.

    Raises:
        SceneError: The batch has no points to mirror.
    """
    points = batch.get('inputs', {}).get('points') if isinstance(batch.get('inputs'), dict) else None
    if points is None:
        raise SceneError(
            'RegionMergeHook: mirror=True needs batches with inputs["points"] (x, y, z, ...); set mirror=False'
        )
    flipped = [scene.clone() for scene in points]
    for scene in flipped:
        scene[:, 1] = -scene[:, 1]
    return batch | {
        'inputs': batch['inputs'] | {'points': flipped},
        'data_samples': copy.deepcopy(batch['data_samples']),
    }


def mirrored_boxes(boxes: Boxes3D) -> Boxes3D:
    """Boxes with y and yaw of the other sign."""
    tensor = boxes.tensor.copy()
    tensor[:, [1, 6]] *= -1
    return Boxes3D(tensor, boxes.labels, boxes.scores)


def agreed_boxes(first: Boxes3D, second: Boxes3D) -> Boxes3D:
    """The boxes of the first look that the second has too, averaged over both.

    A box's counterpart is the one of its class that overlaps it most; the score is the geometric mean of both scores
    times the overlap, so it is low where the two looks place or turn an object differently.

    Args:
        first: Boxes of a scene, duplicates removed.
        second: Boxes of the same scene in the same frame.
    """
    if not len(first) or not len(second):
        return Boxes3D.empty()
    assert first.scores is not None and second.scores is not None
    overlap = rotated_iou_3d(first.tensor, second.tensor) * (first.labels[:, None] == second.labels[None])
    other, shared = overlap.argmax(axis=1), overlap.max(axis=1)
    both = shared >= LEAST_IOU
    a, b = first.select(both), second.select(other[both])
    assert a.scores is not None and b.scores is not None
    scores = np.sqrt(a.scores * b.scores) * shared[both]
    return Boxes3D(_between(a.tensor, b.tensor), a.labels, scores)


def _between(a: Float[np.ndarray, 'boxes 7'], b: Float[np.ndarray, 'boxes 7']) -> Float[np.ndarray, 'boxes 7']:
    """The middle of each pair; the first tells front from back, and which side is the length."""
    turn = 2.0 * (b[:, 6] - a[:, 6])
    middle = (a + b) / 2
    middle[:, 6] = a[:, 6] + 0.25 * np.arctan2(np.sin(turn), np.cos(turn))
    return middle


def agreed_prediction(first: PointPrediction, second: PointPrediction) -> PointPrediction:
    """The first look with the mean of both looks' probabilities, and the boxes that both have.

    Args:
        first: Of the scene as it is.
        second: Of the mirrored scene, its boxes still mirrored.
    """
    probabilities = (first.probabilities + second.probabilities) / 2
    if first.boxes is None or second.boxes is None:
        return PointPrediction(probabilities, first.centers, first.boxes)
    return PointPrediction(probabilities, first.centers, agreed_boxes(first.boxes, mirrored_boxes(second.boxes)))


def predict_scenes(model: Any, batch: dict[str, Any], mirror: bool) -> list[tuple[str, PointPrediction]]:
    """Names of the scenes of a batch, and what the network says of each.

    Args:
        model: In evaluation mode.
        batch: As the data loader gives it.
        mirror: Look twice, see :func:`agreed_prediction`.
    """
    with torch.no_grad():
        first = [scene_prediction(sample) for sample in model.test_step(batch)]
        if not mirror:
            return first
        second = [scene_prediction(sample) for sample in model.test_step(mirrored_batch(batch))]
    return [(scene, agreed_prediction(a, b)) for (scene, a), (_, b) in zip(first, second, strict=True)]
