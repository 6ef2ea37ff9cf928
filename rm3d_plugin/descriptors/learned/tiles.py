"""Scans of any size: boxes of sites with all that can reach them."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


class Tile(NamedTuple):
    """Sites that the network sees together.

    Attributes:
        rows: (n,) int64 sites, ascending.
        core: (n,) bool; what is said of the others is not used.
    """

    rows: Int[np.ndarray, ' sites']
    core: Bool[np.ndarray, ' sites']


def make_tiles(places: Float[np.ndarray, 'sites 3'], reach: float, most: int) -> Iterator[Tile]:
    """Halve a scan along its longest side until no core has more than ``most`` sites; add what lies within ``reach``.

    Each site is in the core of one tile. A network whose answer depends on nothing farther than ``reach`` along an
    axis says the same of it whatever the tiles.

    Args:
        places: (M, 3) in the unit of ``reach``.
        reach: How far the network sees.
        most: Sites of a core. Smaller: less memory, more work at the borders.
    """
    waiting = [(np.arange(len(places)), np.arange(len(places)))] if len(places) else []
    while waiting:
        core, around = waiting.pop()
        if len(core) <= most:
            yield Tile(around, np.isin(around, core, assume_unique=True))
            continue
        axis = int(np.ptp(places[core], axis=0).argmax())
        order = core[np.argsort(places[core, axis], kind='stable')]
        halves = np.sort(order[: len(order) // 2]), np.sort(order[len(order) // 2 :])
        waiting += [(half, _within(places, half, around, reach)) for half in reversed(halves)]


def _within(places: np.ndarray, core: np.ndarray, around: np.ndarray, reach: float) -> Int[np.ndarray, ' rows']:
    low, high = places[core].min(axis=0) - reach, places[core].max(axis=0) + reach
    return around[((places[around] >= low) & (places[around] <= high)).all(axis=1)]


def describe_tiles(
    places: Float[np.ndarray, 'sites 3'],
    reach: float,
    most: int,
    describe: Callable[[Int[np.ndarray, ' rows']], Float[np.ndarray, 'rows features']],
) -> Float[np.ndarray, 'sites features']:
    """What ``describe`` says of the sites of each tile, together; see :func:`make_tiles`."""
    out: np.ndarray | None = None
    for tile in make_tiles(places, reach, most):
        values = describe(tile.rows)[tile.core]
        if out is None:
            out = np.zeros((len(places), values.shape[1]), dtype=np.float32)
        out[tile.rows[tile.core]] = values
    return np.zeros((0, 1), dtype=np.float32) if out is None else out
