"""Drawing which points are annotated to training (METHOD 8): once, by seed, stored with their labels and a hash."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from rm3d_plugin.label_budgets.audit import AnnotatedPoints, DenseTruth, hide_points
from rm3d_plugin.label_budgets.base import BudgetError, by_text, class_lines
from rm3d_plugin.label_budgets.point_amount import PointAmount, point_amount
from rm3d_plugin.storage.files import content_key
from rm3d_plugin.structures import UNLABELLED

FORMAT_VERSION = 1
TruthOf = Callable[[str], DenseTruth]
RowsOf = Callable[[str], Int[np.ndarray, ' original']]


class SceneSize(NamedTuple):
    """What a budget knows of a scene as a whole: its points, how many of them have a label, and its instances."""

    points: int
    labelled: int
    instances: int


@dataclass(frozen=True, eq=False)
class PointBudget:
    """Which points training may see, with their labels.

    Attributes:
        annotated: Scene -> annotated points. Every scene has an entry; that of a complete scene is empty, since there
            everything is annotated.
        complete: Scenes that are labelled completely.
        seed: The seed it was drawn with.
        amount: How much was asked for.
        annotated_per_class: Class number -> annotated points.
        total_per_class: Class number -> points there are.
        sizes: Scene -> its points and instances; :meth:`points_of` checks it.
        hash: Of all of the above.
    """

    annotated: Mapping[str, AnnotatedPoints]
    complete: frozenset[str]
    seed: int
    amount: PointAmount
    annotated_per_class: Mapping[int, int]
    total_per_class: Mapping[int, int]
    sizes: Mapping[str, SceneSize]
    hash: str = field(init=False)

    def __post_init__(self) -> None:
        rows = {name: list(scene) for name, scene in self.annotated.items()}
        object.__setattr__(self, 'hash', content_key('PointBudget', FORMAT_VERSION, self.to_plain(), rows))

    def check(self, scene_id: str, points: int) -> None:
        """Raise a BudgetError unless the budget was drawn from this scene with so many points."""
        if scene_id not in self.sizes:
            raise BudgetError(f'scene {scene_id}: not in this label budget of {len(self.sizes)} scenes; draw it again')
        if self.sizes[scene_id].points != points:
            raise BudgetError(
                f'scene {scene_id}: the label budget was drawn from {self.sizes[scene_id].points} points, the scene '
                f'has {points}; cropping, voxel downsampling or data changed, draw the budget again'
            )

    def points_of(self, scene_id: str, points: int) -> AnnotatedPoints:
        """Annotated points of a scene that is not complete and has ``points`` points.

        Raises:
            BudgetError: The budget was drawn from other scenes, or this scene has other points now.
            ValueError: The scene is complete: its labels are the truth's.
        """
        self.check(scene_id, points)
        if scene_id in self.complete:
            raise ValueError(f'scene {scene_id} is labelled completely; its labels are those of its truth')
        return self.annotated[scene_id]

    def to_plain(self) -> dict[str, Any]:
        """Everything but the hash and the points as plain JSON values."""
        return {
            'seed': self.seed,
            'amount': self.amount.to_plain(),
            'annotated_per_class': by_text(self.annotated_per_class),
            'total_per_class': by_text(self.total_per_class),
            'complete': sorted(self.complete),
            'sizes': {name: list(size) for name, size in self.sizes.items()},
        }

    @property
    def annotated_count(self) -> int:
        """Annotated points over all scenes."""
        return sum(self.annotated_per_class.values())

    def summary(self, classes: Sequence[str] | None = None) -> str:
        """A few lines for the console.

        Args:
            classes: Class names, for readable lines.
        """
        total = sum(self.total_per_class.values())
        used = sum(name in self.complete or len(scene.points) > 0 for name, scene in self.annotated.items())
        share = 100 * self.annotated_count / total if total else 0.0
        whole = f', {len(self.complete)} of them completely' if self.complete else ''
        hidden = '' if self.amount.instances else '; instances stay hidden'
        clicked = self.amount.clicks is not None  # then nobody knows how many labels there are
        what = 'clicked points' if clicked else f'of {total} labelled points ({share:.3g} %)'
        drawn = '' if clicked else f', seed {self.seed}'
        head = (
            f'Label budget {self.hash[:8]}{drawn}: {self.annotated_count} {what} in {used} of {len(self.sizes)} '
            f'scenes{whole}{hidden}'
        )
        there = None if clicked else self.total_per_class
        return '\n'.join([head, *class_lines(self.annotated_per_class, there, classes)])


def draw_point_budget(
    scene_ids: Sequence[str], truth_of: TruthOf, amount: PointAmount | str | Mapping[str, Any], seed: int
) -> PointBudget:
    """Draw the points that training may see (METHOD 8).

    Guaranteed: the same arguments give the same draw, whatever the order of the scenes; what is drawn in a scene
    depends on that scene and the seed alone (but which scenes are complete, on the names of all); with a percentage,
    points per class or per instance every class that a scene holds gets a point there, and with points per scene as
    many classes as there are points. Beyond that every labelled point of a scene has its chance.

    Args:
        scene_ids: Names of all scenes.
        truth_of: The truth of a scene; each is asked for once, one after the other.
        amount: How much, by name or fields.
        seed: Chooses the draw.

    Raises:
        BudgetError: A scene has no point labels, there is nothing to show, or the amount names a file.
    """
    amount = point_amount(amount)
    if amount.file is not None:
        raise BudgetError(f'label budget: {amount.file} says what is annotated, so there is nothing to draw; import it')
    complete = complete_scenes(scene_ids, amount, seed)

    def choose(scene: str, semantic: np.ndarray, instance: np.ndarray) -> np.ndarray:
        if amount.scene_percent is not None:
            return np.zeros(0, dtype=np.int64)
        generator = np.random.default_rng([seed, int(content_key('scene', scene)[:16], 16)])
        return draw_points(semantic, instance, amount, generator)

    return collect_budget(scene_ids, truth_of, choose, complete, amount, seed)


def collect_budget(
    scene_ids: Sequence[str],
    truth_of: TruthOf,
    choose: Callable[[str, np.ndarray, np.ndarray], np.ndarray],
    complete: Collection[str],
    amount: PointAmount,
    seed: int,
) -> PointBudget:
    """Read every scene's truth once, keep the labels of its chosen points, and count.

    Args:
        scene_ids: Names of all scenes.
        truth_of: The truth of a scene.
        choose: From scene, classes and instances of all its points to the numbers of the annotated ones.
        complete: Scenes that are labelled completely.
        amount: What was asked for; kept with the budget.
        seed: Kept with the budget.

    Raises:
        BudgetError: A scene has no point labels, or nothing at all is annotated.
    """
    annotated, sizes = {}, {}
    found, there = [], []
    for scene in sorted(scene_ids):
        truth = truth_of(scene)
        if truth.semantic is None:
            raise BudgetError(f'scene {scene}: has no point labels, so none can be annotated; leave the scene out')
        semantic = np.asarray(truth.semantic, dtype=np.int64)
        instance = np.full(len(semantic), -1) if truth.instance is None else np.asarray(truth.instance)
        rows = np.zeros(0, dtype=np.int64) if scene in complete else choose(scene, semantic, instance)
        annotated[scene] = hide_points(truth, rows, amount.instances)
        sizes[scene] = _size(semantic, instance)
        there.append(_counts_array(semantic))
        found.append(there[-1] if scene in complete else _counts_array(annotated[scene].semantic))
    return checked_budget(annotated, frozenset(complete), seed, amount, _add(found), _add(there), sizes)


def checked_budget(
    annotated: Mapping[str, AnnotatedPoints],
    complete: frozenset[str],
    seed: int,
    amount: PointAmount,
    annotated_per_class: Mapping[int, int],
    total_per_class: Mapping[int, int],
    sizes: Mapping[str, SceneSize],
) -> PointBudget:
    """A budget that shows something.

    Raises:
        BudgetError: It shows nothing.
    """
    if not sum(annotated_per_class.values()):
        raise BudgetError(
            f'no point can be annotated: {len(sizes)} scenes hold {sum(total_per_class.values())} labelled points; '
            'check the data set, its classes and the budget'
        )
    return PointBudget(annotated, complete, seed, amount, annotated_per_class, total_per_class, sizes)


def draw_points(
    semantic: Int[np.ndarray, ' points'],
    instance: Int[np.ndarray, ' points'],
    amount: PointAmount,
    rng: np.random.Generator,
) -> Int[np.ndarray, ' drawn']:
    """Numbers of the points to show in one scene, ascending.

    Args:
        semantic: Class of each point, -1 = none; such points are never drawn.
        instance: Instance of each point, -1 = none; read for points per instance only.
        amount: percent, per_scene, per_class or per_instance.
        rng: Chooses them.
    """
    order = rng.permutation(np.flatnonzero(semantic >= 0))
    classes = semantic[order]
    if amount.per_class is not None:
        chosen = _first_of_each(classes, amount.per_class)
    elif amount.per_instance is not None:
        own = np.where(instance[order] >= 0, instance[order], -1 - classes)  # a class without instances: as one
        chosen = _first_of_each(own, amount.per_instance)
    else:
        one_each = _first_of_each(classes, 1)
        if amount.per_scene is not None:
            count = min(amount.per_scene, len(order))
        else:
            count = max(round((amount.percent or 0.0) / 100 * len(order)), int(one_each.sum()))
        later = np.argsort(~one_each, kind='stable')  # one of each class first, then the others, each as drawn
        chosen = np.zeros(len(order), dtype=bool)
        chosen[later[:count]] = True
    return np.sort(order[chosen])


def complete_scenes(scene_ids: Sequence[str], amount: PointAmount, seed: int) -> frozenset[str]:
    """Scenes that are labelled completely: all, a drawn share of them, or none."""
    if amount.everything:
        return frozenset(scene_ids)
    if amount.scene_percent is None or not len(scene_ids):
        return frozenset()
    count = max(1, round(amount.scene_percent / 100 * len(scene_ids)))
    order = np.random.default_rng(seed).permutation(len(scene_ids))
    return frozenset(np.asarray(sorted(scene_ids))[order[:count]].tolist())


def _first_of_each(values: Int[np.ndarray, ' drawn'], count: int) -> Bool[np.ndarray, ' drawn']:
    """Marks the first ``count`` rows of each value."""
    by_value = np.argsort(values, kind='stable')
    ordered = values[by_value]
    place = np.arange(len(values)) - np.searchsorted(ordered, ordered, side='left')
    marked = np.zeros(len(values), dtype=bool)
    marked[by_value[place < count]] = True
    return marked


def _size(semantic: Int[np.ndarray, ' points'], instance: Int[np.ndarray, ' points']) -> SceneSize:
    counted = instance[(instance >= 0) & (semantic != UNLABELLED)]
    return SceneSize(len(semantic), int((semantic >= 0).sum()), len(np.unique(counted)))


def _counts_array(semantic: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' classes']:
    return np.bincount(semantic[semantic >= 0])


def _add(counts: Sequence[Int[np.ndarray, ' _classes']]) -> dict[int, int]:
    total = np.zeros(max((len(row) for row in counts), default=0), dtype=np.int64)
    for row in counts:
        total[: len(row)] += row
    return {int(number): int(total[number]) for number in np.flatnonzero(total)}
