"""Copying labelled objects of other scenes into this one."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.datasets.transforms.points import POINT_FIELDS, select_points
from rm3d_plugin.ops.boxes import points_in_boxes, rotated_overlap_bev
from rm3d_plugin.registry import TRANSFORMS

FLOOR = 0.3  # m; the lowest part of a box, where ground points are no collision


class LabelledObject(NamedTuple):
    """One truly labelled box (7,), its class, and the points (n, channels) in it."""

    box: Float[np.ndarray, '7']
    label: int
    points: Float[np.ndarray, 'points channels']


def revealed_objects(results: dict[str, Any], min_points: int = 5) -> list[LabelledObject]:
    """The objects of a scene whose boxes the budget revealed, with at least ``min_points`` points."""
    boxes, found = results['boxes'], []
    inside = points_in_boxes(results['points'][:, :3], boxes)
    for row in np.flatnonzero(results['box_is_true']):
        points = results['points'][inside == row]
        if len(points) >= min_points:
            found.append(LabelledObject(boxes[row], int(results['box_labels'][row]), points))
    return found


def is_free(results: dict[str, Any], box: Float[np.ndarray, '7']) -> bool:
    """True where a box overlaps no known box and holds no point above its lowest 0.3 m.

    Hidden objects are unknown to training, but their points are not: a place with points is taken.
    """
    if len(results['boxes']) and rotated_overlap_bev(box[None], results['boxes']).max() > 0:
        return False
    upper = box.copy()
    upper[2] += FLOOR / 2
    upper[5] = max(box[5] - FLOOR, 0.1)
    return not (points_in_boxes(results['points'][:, :3], upper[None]) >= 0).any()


def paste(results: dict[str, Any], item: LabelledObject) -> dict[str, Any]:
    """Add an object; the ground points in its box go. Its points are no points of this scene: ``point_index`` -1."""
    results = select_points(results, points_in_boxes(results['points'][:, :3], item.box[None]) < 0)
    n, row = len(item.points), len(results['boxes'])
    new: dict[str, np.ndarray] = {
        'points': item.points,
        'point_index': np.full(n, -1),
        'semantic': np.full(n, item.label),
        'instance': np.full(n, row),
        'is_true': np.ones(n, dtype=bool),
    }
    out = results | {name: np.concatenate([results[name], new[name]]) for name in POINT_FIELDS}
    out['boxes'] = np.concatenate([results['boxes'], item.box[None]])
    out['box_labels'] = np.append(results['box_labels'], item.label)
    out['box_is_true'] = np.append(results['box_is_true'], True)
    return out


@TRANSFORMS.register_module()
class LabelledObjectPaste:
    """Paste truly labelled objects of other scenes where there is room; labels='store' only.

    Nothing but the label store is asked what is labelled, so nothing hidden can leak. Comes first in the pipeline.

    Args:
        max_objects: Most objects to paste into a scene.
        scenes: Scenes to draw objects from, a scene; each is read from the disk, so more is slower.
        min_points: Objects with fewer points are not worth pasting.
    """

    def __init__(self, max_objects: int = 10, scenes: int = 3, min_points: int = 5) -> None:
        if min(max_objects, scenes, min_points) < 1:
            raise ValueError(f'LabelledObjectPaste: numbers start at 1, got {max_objects}, {scenes}, {min_points}')
        self.max_objects = max_objects
        self.scenes = scenes
        self.min_points = min_points

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw scenes, then paste their objects one by one where they fit."""
        dataset, rng = results['dataset'], results['rng']
        if dataset.labels != 'store':
            raise ValueError(f"LabelledObjectPaste needs a data set with labels='store', got {dataset.labels!r}")
        labelled = dataset.label_store.scenes()
        others: Int[np.ndarray, ' scenes'] = np.flatnonzero(_has_objects(dataset.scene_ids, labelled))
        others = others[others != results['index']]
        objects: list[LabelledObject] = []
        for index in rng.permutation(others)[: self.scenes]:
            objects += revealed_objects(dataset.raw(int(index)), self.min_points)
        pasted = 0
        for number in rng.permutation(len(objects)):
            if pasted < self.max_objects and is_free(results, objects[number].box):
                results = paste(results, objects[number])
                pasted += 1
        return results


def _has_objects(scene_ids: tuple[str, ...], labelled: dict[str, Any]) -> Bool[np.ndarray, ' scenes']:
    return np.array([name in labelled and labelled[name].true_boxes > 0 for name in scene_ids], dtype=bool)
