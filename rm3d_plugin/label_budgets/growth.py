"""A budget of points that grows: a part of it first, and further points as a run asks for them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int

from rm3d_plugin.label_budgets.audit import AnnotatedPoints, hide_points
from rm3d_plugin.label_budgets.base import BudgetError, class_counts
from rm3d_plugin.label_budgets.points import PointBudget, TruthOf


def part_of(budget: PointBudget, count: int, rng: np.random.Generator) -> PointBudget:
    """Some of the annotated points of a budget.

    Args:
        budget: Without scenes that are labelled completely.
        count: Points in all; those of the whole budget at most.
        rng: Chooses them, all alike.

    Raises:
        BudgetError: A scene is labelled completely.
    """
    if budget.complete:
        raise BudgetError(
            f'label budget: {len(budget.complete)} scenes are labelled completely, so it cannot begin with a part of '
            'its points; ask for points in every scene (0p2pct, 20pts, onept)'
        )
    sizes = [len(scene.points) for scene in budget.annotated.values()]
    marked = np.zeros(sum(sizes), dtype=np.bool_)
    marked[rng.permutation(len(marked))[:count]] = True
    parts = np.split(marked, np.cumsum(sizes)[:-1])
    chosen = {
        name: AnnotatedPoints(*(values[own] for values in scene))
        for (name, scene), own in zip(budget.annotated.items(), parts, strict=True)
    }
    return _with_points(budget, chosen)


def grown(budget: PointBudget, truth_of: TruthOf, asked: Mapping[str, Int[np.ndarray, ' asked']]) -> PointBudget:
    """A budget with further points; the truth of no others is read.

    Args:
        budget: What was annotated.
        truth_of: The truth of a scene; only that of scenes with further points is asked for.
        asked: Scene -> points that are annotated now, none of them before. One without a class stays unknown.
    """
    scenes = dict(budget.annotated)
    for name, rows in asked.items():
        if len(rows):
            further = hide_points(truth_of(name), rows, budget.amount.instances)
            scenes[name] = _joined([scenes[name], further])
    return _with_points(budget, scenes)


def _joined(parts: Sequence[AnnotatedPoints]) -> AnnotatedPoints:
    columns = [np.concatenate(values) for values in zip(*parts, strict=True)]
    order = np.argsort(columns[0])
    return AnnotatedPoints(*(values[order] for values in columns))


def _with_points(budget: PointBudget, scenes: Mapping[str, AnnotatedPoints]) -> PointBudget:
    counts = class_counts([points.semantic for points in scenes.values()])
    return replace(budget, annotated=scenes, annotated_per_class=counts)
