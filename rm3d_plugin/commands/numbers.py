"""Numbers of the command line: each is checked when the arguments are read, before anything is imported or computed."""

import argparse
from collections.abc import Callable
from math import inf, isfinite


def whole(least: int = 1, most: float = inf) -> Callable[[str], int]:
    """A whole number from ``least`` on, at most ``most``, as argparse's ``type``."""
    end = '' if most == inf else f' to {most:.0f}'

    def convert(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = least - 1
        if not least <= number <= most:
            raise argparse.ArgumentTypeError(f'expected a whole number from {least}{end}, got {text}')
        return number

    return convert


def number(expected: str, above: float = -inf, least: float = -inf, most: float = inf) -> Callable[[str], float]:
    """A finite number within limits, as argparse's ``type``.

    Args:
        expected: What it is, in words.
        above: It is greater than this.
        least: It is at least this.
        most: It is at most this.
    """

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = inf
        if not (isfinite(value) and value > above and least <= value <= most):
            raise argparse.ArgumentTypeError(f'expected {expected}, got {text}')
        return value

    return convert


SHARE = number('a share from 0 to 1', least=0.0, most=1.0)
METRES = number('metres above 0', above=0.0)
ANY = number('a number')
