"""Scans of any size: boxes of sites with all that can reach them."""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree


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


def make_blocks(places: Float[np.ndarray, 'sites 3'], reach: float, edge: float) -> Iterator[Tile]:
    """The cubes of a fixed grid that hold sites, each with what lies within ``reach`` of it.

    Args:
        places: (M, 3) in the unit of the lengths.
        reach: How far beyond a cube the network sees.
        edge: Of the cubes, whose corners lie at its multiples.
    """
    cells, inverse = np.unique(np.floor(places / edge), axis=0, return_inverse=True)
    order = np.argsort(inverse.reshape(-1), kind='stable')
    cores = np.split(order, np.cumsum(np.bincount(inverse.reshape(-1)))[:-1]) if len(places) else []
    tree = cKDTree(places) if len(places) else None
    for cell, core in zip(cells, cores, strict=True):
        assert tree is not None
        middle, half = (cell + 0.5) * edge, edge / 2 + reach
        rows = np.sort(np.array(tree.query_ball_point(middle, half, p=np.inf), dtype=np.int64))
        yield Tile(rows, np.isin(rows, core, assume_unique=True))


def describe_tiles(
    tiles: Iterable[Tile],
    count: int,
    describe: Callable[[Int[np.ndarray, ' rows']], Float[np.ndarray, 'rows features']],
) -> Float[np.ndarray, 'sites features']:
    """What ``describe`` says of the core of each tile, together; float32.

    Args:
        tiles: Each of the ``count`` sites lies in the core of one.
        count: M.
        describe: Rows of sites -> a vector each.
    """
    out: np.ndarray | None = None
    for tile in tiles:
        values = describe(tile.rows)[tile.core]
        if out is None:
            out = np.zeros((count, values.shape[1]), dtype=np.float32)
        out[tile.rows[tile.core]] = values
    return np.zeros((0, 1), dtype=np.float32) if out is None else out
