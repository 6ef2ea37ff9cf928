"""Box budgets on disk: JSON that a person can read, with a hash that tells when it was altered."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rm3d_plugin.label_budgets.boxes import FORMAT_VERSION, BoxAmount, BoxBudget, BudgetError
from rm3d_plugin.storage.files import read_json, write_json


def save_box_budget(path: str | Path, budget: BoxBudget) -> None:
    """Write a budget as JSON, with its hash."""
    write_json(path, {'format': FORMAT_VERSION, 'hash': budget.hash, **budget.to_plain()})


def load_box_budget(path: str | Path) -> BoxBudget:
    """Read a budget and check its hash.

    Raises:
        BudgetError: The file is missing, is no budget, or was altered.
    """
    try:
        content = read_json(path)
    except FileNotFoundError:
        raise BudgetError(
            f'{path}: no such label budget; a training run draws one; start it without --resume'
        ) from None
    try:
        if content['format'] != FORMAT_VERSION:
            raise BudgetError(f'{path}: format {content["format"]}, expected {FORMAT_VERSION}; draw the budget again')
        budget = _from_content(content)
    except (KeyError, TypeError, AttributeError) as error:
        raise BudgetError(
            f'{path}: not a label budget ({error!r}); a training run draws one; start it without --resume'
        ) from error
    if budget.hash != content.get('hash'):
        raise BudgetError(
            f'{path}: was altered after it was drawn (hash {budget.hash}, written {content.get("hash")}); draw it again'
        )
    return budget


def _from_content(content: Mapping[str, Any]) -> BoxBudget:
    return BoxBudget(
        revealed={name: tuple(rows) for name, rows in content['revealed'].items()},
        complete=content['complete'],
        seed=content['seed'],
        amount=BoxAmount(**content['amount']),
        revealed_per_class={int(number): count for number, count in content['revealed_per_class'].items()},
        total_per_class={int(number): count for number, count in content['total_per_class'].items()},
        boxes_per_scene=content['boxes_per_scene'],
    )
