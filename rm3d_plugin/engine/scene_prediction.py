"""What a model's sample says of the points of its scene, checked: models of other projects say it, too."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from rm3d_plugin.ops.segment import scatter_rows
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.structures import Boxes3D, SceneError, sample_fields

_POINTS = ('pred_point_probs', 'pred_point_centers', 'pred_point_features')
_SLACK = 0.05  # sums of half-precision probabilities are off by so much


def scene_prediction(sample: Any) -> tuple[str, PointPrediction]:
    """Scene and per-point output of one sample, scattered to all points of the scene (NaN where the network saw none).

    Args:
        sample: Of this project or of mmdetection3d; see :func:`~rm3d_plugin.structures.sample_fields`.

    Raises:
        SceneError: The sample lacks ``scene_id`` or ``pred_point_probs``, these are no probabilities, or rows do not
            fit each other.
    """
    fields = sample_fields(sample)
    scene = str(fields.get('scene_id', ''))
    if missing := [name for name in ('scene_id', 'pred_point_probs') if name not in fields]:
        raise SceneError(
            f'RegionMergeHook: the prediction of scene {scene} has no {" and no ".join(missing)}; the model must give '
            'class probabilities of every point in mode "predict"'
        )
    probs = _rows(fields['pred_point_probs'])
    _check_probabilities(probs, scene)
    index = _rows(fields['point_index']).astype(np.int64) if 'point_index' in fields else np.arange(len(probs))
    total = int(fields.get('num_points', len(probs)))
    rows: dict[str, np.ndarray] = {name: _rows(fields[name]) for name in _POINTS if name in fields}
    _check_rows(rows, index, total, scene)
    scattered = {name: scatter_rows(values, index, total, fill=np.nan) for name, values in rows.items()}
    _, centers, features = (scattered.get(name) for name in _POINTS)
    return scene, PointPrediction(scattered['pred_point_probs'], centers, _boxes(fields), features)


def _check_probabilities(probs: np.ndarray, scene: str) -> None:
    seen = probs[~np.isnan(probs).all(axis=-1)] if probs.ndim == 2 else probs
    if probs.ndim != 2 or not ((seen >= -_SLACK).all() and (np.abs(seen.sum(axis=1) - 1) <= _SLACK).all()):
        said = f'{seen.min():.3g} to {seen.max():.3g}' if seen.size else 'nothing'
        raise SceneError(
            f'RegionMergeHook: scene {scene}: pred_point_probs: expected (points, classes) probabilities, rows from 0 '
            f'to 1 that sum to 1, got shape {probs.shape} and {said}; logits? give logits.softmax(dim=1)'
        )


def _check_rows(rows: Mapping[str, np.ndarray], index: np.ndarray, total: int, scene: str) -> None:
    for name, values in rows.items():
        if len(values) != len(index):
            raise SceneError(
                f'RegionMergeHook: scene {scene}: {name}: expected {len(index)} rows, one for each input point, got '
                f'{len(values)}'
            )
    if len(index) and not 0 <= index.min() <= index.max() < total:
        raise SceneError(
            f'RegionMergeHook: scene {scene}: point_index: expected 0..{total - 1} (num_points={total}), got '
            f'{index.min()}..{index.max()}'
        )


def _rows(values: Any) -> np.ndarray:
    if not isinstance(values, torch.Tensor):
        return np.asarray(values)
    rows: np.ndarray = (values.float() if values.is_floating_point() else values).cpu().numpy()  # bfloat16 has no array
    return rows


def _boxes(fields: Mapping[str, Any]) -> Boxes3D | None:
    names = ('pred_bboxes_3d', 'pred_labels_3d', 'pred_scores_3d')
    return Boxes3D(*(_rows(fields[name]) for name in names)) if names[0] in fields else None
