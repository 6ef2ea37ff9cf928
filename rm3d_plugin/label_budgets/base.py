"""What budgets of boxes and of points share: the error, class counts, the summary, the file that a person can read."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Int

from rm3d_plugin.storage.files import MALFORMED, read_json, write_json
from rm3d_plugin.structures import SceneError

AnyBudget = TypeVar('AnyBudget')


class BudgetError(SceneError):
    """A label budget that cannot be drawn or trusted; the message tells why and what to do."""


def class_counts(arrays: Sequence[Int[np.ndarray, ' _labels']]) -> dict[int, int]:
    """Class number -> how often it comes in all arrays together."""
    numbers, counts = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *arrays]), return_counts=True)
    return dict(zip(numbers.tolist(), counts.tolist(), strict=True))


def class_lines(
    annotated: Mapping[int, int], total: Mapping[int, int] | None, classes: Sequence[str] | None = None
) -> list[str]:
    """One line a class: annotated labels of those there are.

    Args:
        annotated: Class number -> annotated labels.
        total: Class number -> labels there are; None: nobody knows.
        classes: Class names, for readable lines.
    """
    every = annotated if total is None else total
    names = {number: classes[number] if classes is not None else f'class {number}' for number in every}
    there = {number: '' if total is None else f' of {total[number]}' for number in every}
    return [f'  {names[number]:<16} {annotated.get(number, 0):>6}{there[number]}' for number in sorted(every)]


def by_text(counts: Mapping[int, int]) -> dict[str, int]:
    """Counts as JSON keeps them."""
    return {str(number): count for number, count in counts.items()}


def by_number(counts: Mapping[str, int]) -> dict[int, int]:
    """Counts as JSON kept them."""
    return {int(number): count for number, count in counts.items()}


def write_budget(path: str | Path, version: int, digest: str, content: Mapping[str, Any]) -> None:
    """Write the plain values of a budget as JSON, with its format version and hash."""
    write_json(path, {'format': version, 'hash': digest, **content})


def read_budget(path: str | Path, version: int, build: Callable[[dict[str, Any]], tuple[AnyBudget, str]]) -> AnyBudget:
    """Read a budget and check its hash.

    Args:
        path: The JSON file.
        version: The format version that ``build`` knows.
        build: The budget and its hash from the plain values; may raise KeyError, TypeError or AttributeError.

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
        if content['format'] != version:
            raise BudgetError(f'{path}: format {content["format"]}, expected {version}; draw the budget again')
        budget, digest = build(content)
    except BudgetError as error:
        raise error if str(path) in str(error) else BudgetError(f'{path}: {error}') from error
    except MALFORMED as error:
        raise BudgetError(
            f'{path}: not a label budget ({error!r}); a training run draws one; start it without --resume'
        ) from error
    if digest != content.get('hash'):
        raise BudgetError(
            f'{path}: was altered after it was drawn (hash {digest}, written {content.get("hash")}); draw it again'
        )
    return budget
