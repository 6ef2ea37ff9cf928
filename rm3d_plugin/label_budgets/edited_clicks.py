"""What became of a file of clicks since a run read it: clicks may be added, those that training has seen must stay."""

from collections.abc import Mapping, Sequence

import numpy as np

from rm3d_plugin.label_budgets.audit import AnnotatedPoints
from rm3d_plugin.label_budgets.base import BudgetError
from rm3d_plugin.label_budgets.points import PointBudget

EXAMPLES = 3  # points that an error lists


def added_clicks(
    kept: PointBudget, now: PointBudget, path: str, classes: Sequence[str]
) -> Mapping[str, AnnotatedPoints]:
    """Points that are clicked now and were not, by scene; scenes without any are left out.

    Args:
        kept: The budget that the run has learnt from.
        now: What the file says.
        path: Of the file, for error messages.
        classes: Names of the classes, for error messages.

    Raises:
        BudgetError: A click is gone or has another label, or a scene has other points or is new.
    """
    added = {}
    for scene, own in now.annotated.items():
        kept.check(scene, now.sizes[scene].points)
        _check_same(scene, kept.annotated[scene], own, path, classes)
        new = ~np.isin(own.points, kept.annotated[scene].points)
        if new.any():
            added[scene] = AnnotatedPoints(*(values[new] for values in own))
    return added


def describe_added(added: Mapping[str, AnnotatedPoints], classes: Sequence[str]) -> str:
    """How many clicks of which classes, scene by scene.

    >>> points = AnnotatedPoints(np.arange(3), np.array([1, 0, 1]), np.full(3, -1))
    >>> describe_added({'street': points}, ['ground', 'tree'])
    'street: 1 ground, 2 tree'
    """
    parts = []
    for scene, points in added.items():
        counts = np.bincount(points.semantic, minlength=len(classes))
        told = [f'{count} {name}' for name, count in zip(classes, counts.tolist(), strict=True) if count]
        parts.append(f'{scene}: {", ".join(told)}')
    return '; '.join(parts)


def _check_same(scene: str, before: AnnotatedPoints, now: AnnotatedPoints, path: str, classes: Sequence[str]) -> None:
    """Whether every point that was annotated still is, with the same label."""
    labels = {point: label for point, *label in zip(*(part.tolist() for part in now), strict=True)}
    wrong = [
        f'point {point} was {_name(label, classes)} and is {_name(labels.get(point), classes)}'
        for point, *label in zip(*(part.tolist() for part in before), strict=True)
        if labels.get(point) != label
    ]
    if wrong:
        more = f' and {len(wrong) - EXAMPLES} others' if len(wrong) > EXAMPLES else ''
        raise BudgetError(
            f'{path}: scene {scene}: {"; ".join(wrong[:EXAMPLES])}{more}, but the run has learnt from them; put them '
            'back as they were (clicks may be added), or start in another work dir'
        )


def _name(label: Sequence[int] | None, classes: Sequence[str]) -> str:
    if label is None:
        return 'gone'
    semantic, instance = label
    return classes[semantic] if instance < 0 else f'{classes[semantic]} (instance {instance})'
