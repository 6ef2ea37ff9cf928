"""One way to refuse a value of a dataclass of settings."""

from math import isfinite
from typing import Any


def check_field(owner: object, name: str, good: bool, expected: str) -> None:
    """Refuse the value of a field unless it is good.

    Args:
        owner: A dataclass.
        name: One of its fields.
        good: Whether its value is allowed.
        expected: What is, in words.

    Raises:
        ValueError: It is not good; the message names class, field and value.
    """
    if not good:
        raise ValueError(f'{type(owner).__name__}.{name}: expected {expected}, got {getattr(owner, name)!r}')


def check_switches(owner: object, *names: str) -> None:
    """Refuse what is neither True nor False; see :func:`check_field`."""
    for name in names:
        check_field(owner, name, isinstance(getattr(owner, name), bool), 'True or False')


def check_positive(owner: object, *names: str, optional: bool = False) -> None:
    """Refuse what is no finite number above 0 (nor None, where ``optional``); see :func:`check_field`."""
    for name in names:
        value: Any = getattr(owner, name)
        good = optional if value is None else isfinite(value) and value > 0
        check_field(owner, name, good, 'a number > 0, or None' if optional else 'a number > 0')


def check_choice(owner: object, name: str, choices: tuple[Any, ...]) -> None:
    """Refuse what is none of the choices; see :func:`check_field`."""
    check_field(owner, name, getattr(owner, name) in choices, f'one of {choices}')
