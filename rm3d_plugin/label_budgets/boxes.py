"""Drawing which boxes are annotated to training (METHOD 8): once, by seed, stored with a hash."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.label_budgets.base import BudgetError, by_text, class_counts, class_lines
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.storage.files import content_key

FORMAT_VERSION = 1


@dataclass(frozen=True)
class BoxAmount:
    """How many boxes are annotated: exactly one of the two.

    Attributes:
        per_scene: Boxes for each scene on average (0.2 = two per ten scenes).
        fraction: Share of all boxes in (0, 1]; 1 shows everything, and scenes then count as completely labelled.
        alike: Classes take turns, so that each has as many annotated boxes as another while it has usable ones, as a
            person would choose who labels a few; False: frequent classes are drawn more often.
    """

    per_scene: float | None = None
    fraction: float | None = None
    alike: bool = False

    def __post_init__(self) -> None:
        if (self.per_scene is None) == (self.fraction is None):
            raise ValueError(f'BoxAmount: expected per_scene or fraction, got {self}')
        if self.per_scene is not None and not 0 < self.per_scene < np.inf:
            raise ValueError(f'BoxAmount.per_scene: expected a number above 0, got {self.per_scene}')
        if self.fraction is not None and not 0 < self.fraction <= 1:
            raise ValueError(f'BoxAmount.fraction: expected a share in (0, 1], got {self.fraction}')

    @property
    def everything(self) -> bool:
        """True where nothing stays hidden."""
        return self.fraction == 1

    def count(self, scenes: int, boxes: int) -> int:
        """Boxes to show, at least one."""
        wanted = self.per_scene * scenes if self.per_scene is not None else (self.fraction or 0.0) * boxes
        return max(1, round(wanted))


BOX_BUDGETS = {  # METHOD 8: two boxes per ten scenes are called 1 %, one per ten 0.5 %
    '1pct': BoxAmount(per_scene=0.2),
    '0p5pct': BoxAmount(per_scene=0.1),
    '3pct': BoxAmount(fraction=0.03),
    'full': BoxAmount(fraction=1.0),
}


@dataclass(frozen=True)
class BoxBudget:
    """Which boxes training may see.

    Attributes:
        annotated: Scene -> rows of its truth's boxes, ascending; every scene has an entry.
        complete: True where every box of every scene is annotated, so that what has none is background.
        seed: The seed it was drawn with.
        amount: How much was asked for.
        annotated_per_class: Class number -> annotated boxes.
        total_per_class: Class number -> boxes there are.
        boxes_per_scene: Scene -> boxes there are; :meth:`rows` checks it.
        hash: Of all of the above.
    """

    annotated: Mapping[str, tuple[int, ...]]
    complete: bool
    seed: int
    amount: BoxAmount
    annotated_per_class: Mapping[int, int]
    total_per_class: Mapping[int, int]
    boxes_per_scene: Mapping[str, int]
    hash: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'hash', content_key('BoxBudget', FORMAT_VERSION, self.to_plain()))

    def rows(self, scene_id: str, boxes: int) -> tuple[int, ...]:
        """Annotated rows of a scene that has ``boxes`` boxes.

        Raises:
            BudgetError: The budget was drawn from other scenes, or this scene has other boxes now.
        """
        if scene_id not in self.annotated:
            raise BudgetError(
                f'scene {scene_id}: not in this label budget of {len(self.annotated)} scenes; draw it again'
            )
        if self.boxes_per_scene[scene_id] != boxes:
            raise BudgetError(
                f'scene {scene_id}: the label budget was drawn from {self.boxes_per_scene[scene_id]} boxes, the scene '
                f'has {boxes}; classes, range or data changed, draw the budget again'
            )
        return self.annotated[scene_id]

    def to_plain(self) -> dict[str, Any]:
        """Everything but the hash as plain JSON values."""
        return {
            'seed': self.seed,
            'complete': self.complete,
            'amount': _plain_amount(self.amount),
            'annotated_per_class': by_text(self.annotated_per_class),
            'total_per_class': by_text(self.total_per_class),
            'boxes_per_scene': dict(self.boxes_per_scene),
            'annotated': {name: list(rows) for name, rows in self.annotated.items()},
        }

    @property
    def annotated_count(self) -> int:
        """Annotated boxes over all scenes."""
        return sum(len(rows) for rows in self.annotated.values())

    def summary(self, classes: Sequence[str] | None = None) -> str:
        """A few lines for the console.

        Args:
            classes: Class names, for readable lines.
        """
        total = sum(self.total_per_class.values())
        used = sum(bool(rows) for rows in self.annotated.values())
        share = 100 * self.annotated_count / total if total else 0.0
        head = (
            f'Label budget {self.hash[:8]}, seed {self.seed}: {self.annotated_count} of {total} boxes ({share:.2f} %) '
            f'in {used} of {len(self.annotated)} scenes'
        )
        return '\n'.join([head, *class_lines(self.annotated_per_class, self.total_per_class, classes)])


def draw_box_budget(
    labels_per_scene: Mapping[str, Int[np.ndarray, ' _boxes']],
    amount: BoxAmount | str,
    seed: int,
    lidar_points: Mapping[str, Int[np.ndarray, ' _boxes']] | None = None,
    min_points: int = 5,
) -> BoxBudget:
    """Draw the boxes that training may see (METHOD 8).

    Guaranteed: the same arguments give the same draw, whatever the order of the scenes; every class with a usable box
    gets at least one while the amount allows (the most frequent classes first where it does not); no scene gets a
    second box while a scene with a usable one has none, but where a class would else go empty (or, with ``alike``,
    fall behind). Beyond that every usable box has its chance.

    Args:
        labels_per_scene: Scene -> class number of each box, in the order of the scene's truth.
        amount: How many, or a name of BOX_BUDGETS.
        seed: Chooses the draw.
        lidar_points: Scene -> points in each box; needed for ``min_points`` to matter.
        min_points: Boxes with fewer points are usable only where everything is annotated.

    Returns:
        The budget; fewer boxes than asked for where fewer are usable.

    Raises:
        BudgetError: There is no usable box, or lidar_points does not fit the boxes.
    """
    if isinstance(amount, str):
        amount = _named(amount)
    scenes = sorted(labels_per_scene)
    labels = {name: np.asarray(labels_per_scene[name], dtype=np.int64).reshape(-1) for name in scenes}
    if amount.everything:
        chosen = {name: tuple(range(len(labels[name]))) for name in scenes}
    else:
        scene_of, row_of, class_of = _usable(labels, lidar_points, min_points)
        count = amount.count(len(scenes), sum(len(rows) for rows in labels.values()))
        order = np.random.default_rng(seed).permutation(len(class_of))
        pick = _pick_alike if amount.alike else _pick
        picked = order[pick(scene_of[order], class_of[order], count)]
        chosen = {name: tuple(sorted(row_of[picked[scene_of[picked] == i]].tolist())) for i, name in enumerate(scenes)}
    annotated = [labels[name][list(chosen[name])] for name in scenes]
    return BoxBudget(
        annotated=chosen,
        complete=amount.everything,
        seed=seed,
        amount=amount,
        annotated_per_class=class_counts(annotated),
        total_per_class=class_counts(list(labels.values())),
        boxes_per_scene={name: len(labels[name]) for name in scenes},
    )


def count_points(xyz: Float[np.ndarray, 'points 3'], boxes: Float[np.ndarray, 'boxes 7']) -> Int[np.ndarray, ' boxes']:
    """Points in each box (in two boxes: the first has it), for ``lidar_points``."""
    inside = points_in_boxes(xyz, boxes)
    return np.bincount(inside[inside >= 0], minlength=len(boxes))


def _named(name: str) -> BoxAmount:
    if name not in BOX_BUDGETS:
        raise BudgetError(f'label budget: expected one of {", ".join(BOX_BUDGETS)}, got {name!r}')
    return BOX_BUDGETS[name]


def _usable(
    labels: Mapping[str, np.ndarray], lidar_points: Mapping[str, np.ndarray] | None, min_points: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scene number, row and class of every box that may be drawn."""
    found = []
    for i, (name, classes) in enumerate(labels.items()):
        rows = np.arange(len(classes))
        if lidar_points is not None:
            points = np.asarray(lidar_points[name]).reshape(-1) if name in lidar_points else np.zeros(0)
            if len(points) != len(classes):
                raise BudgetError(f'scene {name}: {len(classes)} boxes, but lidar_points has {len(points)} numbers')
            rows = rows[points >= min_points]
        found.append(np.stack([np.full(len(rows), i), rows, classes[rows]]))
    scene_of, row_of, class_of = np.concatenate(found, axis=1) if found else np.zeros((3, 0), dtype=np.int64)
    if len(class_of) == 0:
        total = sum(len(classes) for classes in labels.values())
        raise BudgetError(
            f'no box can be annotated: {len(labels)} scenes hold {total} boxes, none with {min_points} points; '
            'check classes and range, or lower min_points'
        )
    return scene_of, row_of, class_of


def _plain_amount(amount: BoxAmount) -> dict[str, Any]:
    plain: dict[str, Any] = {'per_scene': amount.per_scene, 'fraction': amount.fraction}
    return plain | {'alike': True} if amount.alike else plain


def _pick_alike(scenes: np.ndarray, classes: np.ndarray, count: int) -> list[int]:
    """Positions to take from candidates in drawn order: the classes in turn, rarest first, each from a fresh scene."""
    numbers, frequency = np.unique(classes, return_counts=True)
    waiting = {int(c): np.flatnonzero(classes == c).tolist() for c in numbers[np.argsort(frequency, kind='stable')]}
    used: dict[int, int] = {}
    taken: list[int] = []
    while len(taken) < count and any(waiting.values()):
        for own in waiting.values():
            if own and len(taken) < count:
                position = min(own, key=lambda p: (used.get(int(scenes[p]), 0), p))
                own.remove(position)
                taken.append(position)
                used[int(scenes[position])] = used.get(int(scenes[position]), 0) + 1
    return taken


def _pick(scenes: np.ndarray, classes: np.ndarray, count: int) -> list[int]:
    """Positions to take from candidates in drawn order: one of each class, then scene by scene."""
    taken: list[int] = []
    used: dict[int, int] = {}

    def take(position: int) -> None:
        taken.append(position)
        used[int(scenes[position])] = used.get(int(scenes[position]), 0) + 1

    numbers, frequency = np.unique(classes, return_counts=True)
    served = numbers[np.argsort(-frequency, kind='stable')][:count]
    for number in served[::-1]:  # rarest first: the fewer boxes a class has, the fewer free scenes it can choose from
        own = np.flatnonzero(classes == number)
        take(int(min(own, key=lambda position: (used.get(int(scenes[position]), 0), position))))
    left = np.setdiff1d(np.arange(len(classes)), taken).tolist()
    level = 1
    while len(taken) < count and left:
        later = []
        for position in left:
            if len(taken) < count and used.get(int(scenes[position]), 0) < level:
                take(position)
            else:
                later.append(position)
        left, level = later, level + 1
    return taken
