"""Copying labelled objects of other scenes into this one: few labels, seen in many places."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.transforms.geometric import turned
from rm3d_plugin.datasets.transforms.points import POINT_FIELDS, select_points
from rm3d_plugin.ops.boxes import points_in_boxes, rotated_overlap_bev
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.registry import TRANSFORMS

FLOOR = 0.3  # m; the lowest part of a box, where ground points are no collision
TRIES = 4  # places tried for an object before it is given up


class LabelledObject(NamedTuple):
    """One box (7,), its class, the points (n, channels) in it, ground left out, and whether it was annotated."""

    box: Float[np.ndarray, '7']
    label: int
    points: Float[np.ndarray, 'points channels']
    annotated: bool = True


@dataclass(frozen=True)
class Places:
    """Where an object may be put, seen from a sensor at the origin.

    It turns around the sensor, so that the sensor goes on seeing the same faces, and moves away from it, losing points
    as the square of the distance; it never comes nearer, where points would be missing.

    Attributes:
        bearing: Least and greatest direction, radians from +x.
        farther: Greatest factor of the distance; 1: it keeps its distance.
        max_range: Greatest distance, metres.
    """

    bearing: tuple[float, float] = (-0.7, 0.7)
    farther: float = 2.0
    max_range: float = 65.0


def labelled_objects(results: dict[str, Any], min_points: int = 5, accepted: bool = False) -> list[LabelledObject]:
    """The objects of a scene with at least ``min_points`` points above the ground.

    Args:
        results: An item of a data set, with the labels of the round.
        min_points: An object needs as many.
        accepted: Pseudo boxes count, too; else those alone that the budget annotated.
    """
    boxes, found = results['boxes'], []
    inside = points_in_boxes(results['points'][:, :3], boxes)
    inside[segment_ground(results['points'][:, :3]).is_ground] = -1
    for row, annotated in enumerate(results['box_is_annotated'].tolist()):
        points = results['points'][inside == row] if annotated or accepted else inside[:0]
        if len(points) >= min_points:
            found.append(LabelledObject(boxes[row], int(results['box_labels'][row]), points, annotated))
    return found


def moved(item: LabelledObject, places: Places, rng: np.random.Generator) -> LabelledObject:
    """The same object at a random place, perhaps mirrored, with the fewer points of its new distance."""
    box, points = item.box.copy(), item.points.astype(np.float64)
    if rng.random() < 0.5:
        box[[1, 6]] *= -1
        points[:, 1] *= -1
    distance = float(np.hypot(box[0], box[1]))
    target = min(distance * rng.uniform(1.0, places.farther), max(places.max_range, distance))
    bearing = rng.uniform(*places.bearing)
    turn = bearing - float(np.arctan2(box[1], box[0]))
    away = (target - distance) * np.array([np.cos(bearing), np.sin(bearing), 0.0])
    box[:3], points[:, :3] = turned(box[None, :3], turn)[0] + away, turned(points[:, :3], turn) + away
    box[6] = (box[6] + turn + np.pi) % (2 * np.pi) - np.pi
    kept = rng.random(len(points)) < (distance / max(target, 1e-6)) ** 2
    return item._replace(box=box, points=points[kept].astype(np.float32))


def put_on_ground(item: LabelledObject, xyz: np.ndarray, height: np.ndarray) -> LabelledObject:
    """The object moved up or down until it stands on the ground of the scene.

    Args:
        item: The object.
        xyz: Points of the scene, metres.
        height: Their height above the ground, metres.
    """
    nearest = int(np.argmin(np.square(xyz[:, :2] - item.box[:2]).sum(axis=1)))
    shift = float(xyz[nearest, 2] - height[nearest]) - (item.box[2] - item.box[5] / 2)
    box, points = item.box.copy(), item.points.copy()
    box[2] += shift
    points[:, 2] += np.float32(shift)
    return item._replace(box=box, points=points)


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
        'is_annotated': np.full(n, item.annotated),
        'confidence': np.ones(n, dtype=np.float32),
        'is_ground': np.zeros(n, dtype=bool),
        'ground_height': item.points[:, 2] - (item.box[2] - item.box[5] / 2),
    }
    out = results | {name: np.concatenate([results[name], new[name]]) for name in POINT_FIELDS if name in results}
    out['boxes'] = np.concatenate([results['boxes'], item.box[None]])
    out['box_labels'] = np.append(results['box_labels'], item.label)
    out['box_is_annotated'] = np.append(results['box_is_annotated'], item.annotated)
    return out


@TRANSFORMS.register_module()
class LabelledObjectPaste:
    """Paste labelled objects where there is room; labels='store' only. Comes first in the pipeline.

    Classes are drawn alike, however few objects they have. Nothing but the label store is asked what is labelled, so
    nothing hidden can leak (``label_budgets.check_objects`` proves it).

    Args:
        max_objects: Most objects to paste into a scene.
        max_bank: Most objects to choose from; more cost memory.
        min_points: Objects with fewer points are not worth pasting.
        places: Fields of :class:`Places`.
        accepted: Pseudo objects of the round are pasted, too; as pseudo objects. False: annotated ones alone.
    """

    def __init__(
        self,
        max_objects: int = 8,
        max_bank: int = 2000,
        min_points: int = 5,
        places: dict[str, Any] | None = None,
        accepted: bool = False,
    ) -> None:
        if min(max_objects, max_bank, min_points) < 1:
            raise ValueError(f'LabelledObjectPaste: numbers start at 1, got {max_objects}, {max_bank}, {min_points}')
        self.max_objects, self.max_bank, self.min_points = max_objects, max_bank, min_points
        self.places = Places(**(places or {}))
        self.accepted = accepted
        self._bank: tuple[int, list[list[LabelledObject]]] | None = None

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw a class, one of its objects and a place, until there are enough."""
        rng = results['rng']
        bank = self.bank(results['dataset'])
        if not bank:
            return results
        ground = segment_ground(results['points'][:, :3])
        xyz, height = results['points'][:, :3], ground.height
        results = results | {'is_ground': ground.is_ground}
        for _ in range(self.max_objects):
            of_class = bank[int(rng.integers(len(bank)))]
            item = of_class[int(rng.integers(len(of_class)))]
            for _ in range(TRIES):
                candidate = put_on_ground(moved(item, self.places, rng), xyz, height)
                if len(candidate.points) >= self.min_points and is_free(results, candidate.box):
                    results = paste(results, candidate)
                    break
        return results

    def bank(self, dataset: Any) -> list[list[LabelledObject]]:
        """Objects by class that may be pasted, read once a round.

        Raises:
            ValueError: The data set does not read the label store.
        """
        if dataset.labels != 'store':
            raise ValueError(f"LabelledObjectPaste needs a data set with labels='store', got {dataset.labels!r}")
        number = int(dataset.label_store.current_round() or 0) if self.accepted else 0  # annotated boxes stay the same
        if self._bank is None or self._bank[0] != number:
            found: list[LabelledObject] = []
            for index in _with_objects(dataset, self.accepted):
                found += labelled_objects(dataset.raw(int(index)), self.min_points, self.accepted)
                if len(found) >= self.max_bank:
                    break
            by_class = [[item for item in found if item.label == c] for c in range(len(dataset.classes))]
            self._bank = (number, [objects for objects in by_class if objects])
        return self._bank[1]


def _with_objects(dataset: Any, accepted: bool) -> Int[np.ndarray, ' scenes']:
    labelled = dataset.label_store.scenes()
    has = [name in labelled and (accepted or labelled[name].true_boxes > 0) for name in dataset.scene_ids]
    return np.flatnonzero(np.array(has, dtype=bool))
