"""Box budgets on disk: JSON that a person can read, with a hash that tells when it was altered."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rm3d_plugin.label_budgets.base import by_number, read_budget, write_budget
from rm3d_plugin.label_budgets.box_amount import BoxAmount
from rm3d_plugin.label_budgets.boxes import FORMAT_VERSION, BoxBudget


def save_box_budget(path: str | Path, budget: BoxBudget) -> None:
    """Write a budget as JSON, with its hash."""
    write_budget(path, FORMAT_VERSION, budget.hash, budget.to_plain())


def load_box_budget(path: str | Path) -> BoxBudget:
    """Read a budget and check its hash.

    Raises:
        BudgetError: The file is missing, is no budget, or was altered.
    """
    return read_budget(path, FORMAT_VERSION, _from_content)


def _from_content(content: Mapping[str, Any]) -> tuple[BoxBudget, str]:
    budget = BoxBudget(
        annotated={name: tuple(rows) for name, rows in content['annotated'].items()},
        complete=content['complete'],
        seed=content['seed'],
        amount=BoxAmount(**content['amount']),
        annotated_per_class=by_number(content['annotated_per_class']),
        total_per_class=by_number(content['total_per_class']),
        boxes_per_scene=content['boxes_per_scene'],
        complete_scenes=tuple(content.get('complete_scenes', ())),
    )
    return budget, budget.hash
