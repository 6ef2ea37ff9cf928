"""Point budgets on disk: JSON that a person can read, and the annotated points beside it in an npz file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.label_budgets.audit import AnnotatedPoints
from rm3d_plugin.label_budgets.base import BudgetError, by_number, read_budget, write_budget
from rm3d_plugin.label_budgets.point_amount import PointAmount
from rm3d_plugin.label_budgets.points import FORMAT_VERSION, PointBudget, SceneSize
from rm3d_plugin.storage.files import DamagedFileError, read_npz, write_npz


def save_point_budget(path: str | Path, budget: PointBudget) -> None:
    """Write ``NAME.json`` (what was asked for, counts, hash) and ``NAME.npz`` (points and labels).

    The npz file holds ``offsets`` (S + 1,): by them rows of ``points``, ``semantic`` and ``instance`` belong to the
    scenes in the order of the JSON file's ``sizes``.
    """
    path = Path(path)
    scenes = list(budget.annotated.values())
    sizes = [len(scene.points) for scene in scenes]
    arrays = {
        name: np.concatenate([np.zeros(0, dtype=np.int64), *(getattr(scene, name) for scene in scenes)])
        for name in AnnotatedPoints._fields
    }
    write_npz(_points_file(path), {'offsets': np.cumsum([0, *sizes]), **arrays})
    write_budget(path, FORMAT_VERSION, budget.hash, {'kind': 'points', **budget.to_plain()})


def load_point_budget(path: str | Path) -> PointBudget:
    """Read a budget and check its hash.

    Raises:
        BudgetError: A file is missing, is no budget of points, or was altered.
    """
    path = Path(path)

    def build(content: dict[str, Any]) -> tuple[PointBudget, str]:
        if content.get('kind') != 'points':
            raise BudgetError(f'{path}: is no budget of points; give the budget of a segmentation run, or draw one')
        budget = _from_content(content, _read_points(path))
        return budget, budget.hash

    return read_budget(path, FORMAT_VERSION, build)


def _points_file(path: Path) -> Path:
    return path.with_suffix('.npz')


def _read_points(path: Path) -> dict[str, np.ndarray]:
    try:
        return read_npz(_points_file(path))
    except FileNotFoundError:
        raise BudgetError(
            f'{_points_file(path)}: missing; the points of {path} belong there; copy both files, or draw it again'
        ) from None
    except DamagedFileError as error:
        raise BudgetError(f'label budget: {error}') from error


def _from_content(content: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> PointBudget:
    scenes, offsets = list(content['sizes']), arrays['offsets']
    if len(offsets) != len(scenes) + 1:
        raise KeyError(f'{len(offsets) - 1} scenes in the npz file, {len(scenes)} in the JSON file')
    annotated = {
        scene: AnnotatedPoints(*(arrays[name][offsets[i] : offsets[i + 1]] for name in AnnotatedPoints._fields))
        for i, scene in enumerate(scenes)
    }
    return PointBudget(
        annotated=annotated,
        complete=frozenset(content['complete']),
        seed=content['seed'],
        amount=PointAmount(**content['amount']),
        annotated_per_class=by_number(content['annotated_per_class']),
        total_per_class=by_number(content['total_per_class']),
        sizes={scene: SceneSize(*size) for scene, size in content['sizes'].items()},
    )
