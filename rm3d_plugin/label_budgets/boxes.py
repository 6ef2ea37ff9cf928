"""Drawing which boxes are annotated to training (METHOD 8): once, by seed, stored with a hash."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.label_budgets.base import BudgetError, by_text, class_counts, class_lines
from rm3d_plugin.label_budgets.box_amount import BoxAmount, box_amount
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.storage.files import content_key

FORMAT_VERSION = 1


@dataclass(frozen=True)
class BoxBudget:
    """Which boxes training may see.

    Attributes:
        annotated: Scene -> rows of its truth's boxes, ascending; every scene has an entry.
        complete: True where every box of every scene is annotated, so that what has none is background.
        complete_scenes: Scenes of which that is so, where it is not so of all.
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
    complete_scenes: tuple[str, ...] = ()
    hash: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'hash', content_key('BoxBudget', FORMAT_VERSION, self.to_plain()))

    def is_complete(self, scene_id: str) -> bool:
        """Whether what has no box in a scene is background."""
        return self.complete or scene_id in self.complete_scenes

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
        some = {'complete_scenes': sorted(self.complete_scenes)} if self.complete_scenes else {}
        return some | {
            'seed': self.seed,
            'complete': self.complete,
            'amount': self.amount.to_plain(),
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
    unlabelled: Collection[str] = (),
) -> BoxBudget:
    """Draw the boxes that training may see (METHOD 8).

    Guaranteed: the same arguments give the same draw, whatever the order of the scenes; every class with a usable box
    gets at least one while the amount allows (the most frequent classes first where it does not); no scene gets a
    second box while a scene with a usable one has none, but where a class would else go empty (or, with ``alike``,
    fall behind). Beyond that every usable box has its chance.

    Args:
        labels_per_scene: Scene -> class number of each box, in the order of the scene's truth.
        amount: How many, or a name that :func:`~rm3d_plugin.label_budgets.box_amount.box_amount` knows.
        seed: Chooses the draw.
        lidar_points: Scene -> points in each box; needed for ``min_points`` to matter.
        min_points: Boxes with fewer points are usable only where everything is annotated.
        unlabelled: Scenes of which nobody knows the boxes; none is drawn there, and they are never complete.

    Returns:
        The budget; fewer boxes than asked for where fewer are usable.

    Raises:
        BudgetError: There is no usable box, or lidar_points does not fit the boxes.
    """
    if isinstance(amount, str):
        amount = box_amount(amount)
    scenes = sorted(labels_per_scene)
    labels = {name: np.asarray(labels_per_scene[name], dtype=np.int64).reshape(-1) for name in scenes}
    known = {name: rows for name, rows in labels.items() if name not in unlabelled}
    chosen: dict[str, tuple[int, ...]] = dict.fromkeys(scenes, ())
    complete: tuple[str, ...] = ()
    if amount.everything:
        complete = _drawn_scenes(list(known), amount.scenes, seed)
        chosen |= {name: tuple(range(len(labels[name]))) for name in complete}
    else:
        chosen |= _drawn_boxes(known, amount, seed, lidar_points, min_points)
    whole = len(complete) == len(scenes)
    return BoxBudget(
        annotated=chosen,
        complete=whole,
        seed=seed,
        amount=amount,
        annotated_per_class=class_counts([labels[name][list(chosen[name])] for name in scenes]),
        total_per_class=class_counts(list(labels.values())),
        boxes_per_scene={name: len(labels[name]) for name in scenes},
        complete_scenes=() if whole else complete,
    )


def _drawn_boxes(
    labels: Mapping[str, np.ndarray],
    amount: BoxAmount,
    seed: int,
    lidar_points: Mapping[str, np.ndarray] | None,
    min_points: int,
) -> dict[str, tuple[int, ...]]:
    """Rows of each scene that are annotated, where some stay hidden."""
    usable = _usable(labels, lidar_points, min_points)
    names = list(labels)
    holding = names if amount.scenes == 1 else [names[i] for i in np.unique(usable[0])]
    drawn = _drawn_scenes(holding, amount.scenes, seed)
    usable = usable[:, np.isin(usable[0], [names.index(name) for name in drawn])]
    count = amount.count(len(drawn), sum(len(labels[name]) for name in drawn))
    scene_of, row_of, class_of = usable
    order = np.random.default_rng(seed).permutation(len(class_of))
    pick = _pick_alike if amount.alike else _pick
    picked = order[pick(scene_of[order], class_of[order], count, amount.each)]
    return {name: tuple(sorted(row_of[picked[scene_of[picked] == i]].tolist())) for i, name in enumerate(names)}


def _drawn_scenes(names: Sequence[str], share: float, seed: int) -> tuple[str, ...]:
    """A share of the scenes, at least one, in their order."""
    if share == 1:
        return tuple(names)
    count = max(1, round(share * len(names)))
    rows = np.random.default_rng([seed, 1]).permutation(len(names))[:count]
    return tuple(names[i] for i in sorted(rows.tolist()))


def count_points(xyz: Float[np.ndarray, 'points 3'], boxes: Float[np.ndarray, 'boxes 7']) -> Int[np.ndarray, ' boxes']:
    """Points in each box (in two boxes: the first has it), for ``lidar_points``."""
    inside = points_in_boxes(xyz, boxes)
    return np.bincount(inside[inside >= 0], minlength=len(boxes))


def _usable(
    labels: Mapping[str, np.ndarray], lidar_points: Mapping[str, np.ndarray] | None, min_points: int
) -> Int[np.ndarray, '3 usable']:
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
    usable = np.concatenate(found, axis=1) if found else np.zeros((3, 0), dtype=np.int64)
    if usable.shape[1] == 0:
        total = sum(len(classes) for classes in labels.values())
        raise BudgetError(
            f'no box can be annotated: {len(labels)} scenes hold {total} boxes, none with {min_points} points; '
            'check classes and range, or lower min_points'
        )
    return usable


def _pick_alike(scenes: np.ndarray, classes: np.ndarray, count: int, most: int | None = None) -> list[int]:
    """Positions to take from candidates in drawn order: the classes in turn, rarest first, each from a fresh scene.

    No scene gives more than ``most``.
    """
    numbers, frequency = np.unique(classes, return_counts=True)
    waiting = {int(c): np.flatnonzero(classes == c).tolist() for c in numbers[np.argsort(frequency, kind='stable')]}
    used: dict[int, int] = {}
    taken: list[int] = []
    while len(taken) < count and any(waiting.values()):
        for own in waiting.values():
            if own and len(taken) < count:
                position = min(own, key=lambda p: (used.get(int(scenes[p]), 0), p))
                own.remove(position)
                if most is None or used.get(int(scenes[position]), 0) < most:
                    taken.append(position)
                    used[int(scenes[position])] = used.get(int(scenes[position]), 0) + 1
    return taken


def _pick(scenes: np.ndarray, classes: np.ndarray, count: int, most: int | None = None) -> list[int]:
    """Positions to take from candidates in drawn order: one of each class, then scene by scene, ``most`` of each."""
    taken: list[int] = []
    used: dict[int, int] = {}

    def take(position: int) -> None:
        taken.append(position)
        used[int(scenes[position])] = used.get(int(scenes[position]), 0) + 1

    numbers, frequency = np.unique(classes, return_counts=True)
    served = numbers[np.argsort(-frequency, kind='stable')][:count]
    for number in served[::-1]:  # rarest first: the fewer boxes a class has, the fewer free scenes it can choose from
        own = np.flatnonzero(classes == number)
        first = int(min(own, key=lambda position: (used.get(int(scenes[position]), 0), position)))
        if most is None or used.get(int(scenes[first]), 0) < most:
            take(first)
    left = np.setdiff1d(np.arange(len(classes)), taken).tolist()
    level = 1
    while len(taken) < count and left and (most is None or level <= most):
        later = []
        for position in left:
            if len(taken) < count and used.get(int(scenes[position]), 0) < level:
                take(position)
            else:
                later.append(position)
        left, level = later, level + 1
    return taken
