"""Two overlapping crops of one scan, moved, noisy and of other density: what descriptors learn from without labels."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.transforms.augmented_view import View
from rm3d_plugin.datasets.transforms.geometric import turned
from rm3d_plugin.datasets.transforms.points import random_subset, select_points
from rm3d_plugin.ops.viewpoint import virtual_viewpoint
from rm3d_plugin.registry import TRANSFORMS

Turn = Literal['so3', 'z', 'none']
CENTRES = 8  # that are tried for the second crop


@dataclass(frozen=True)
class PairSettings:
    """How two crops of a scan are taken.

    Attributes:
        points: Points of a crop before it is thinned; at most two thirds of the scan. Larger: more context, slower.
        overlap: Least and greatest share of its points that a crop has in common with the other.
        keep: Least and greatest share of a crop's points that stay, drawn for each crop: they differ in density.
        jitter: Standard deviation of each coordinate's noise, metres; cut off at three times that.
        turn: Each crop is turned by itself: freely, about z, or not at all.
    """

    points: int = 20_000
    overlap: tuple[float, float] = (0.3, 0.9)
    keep: tuple[float, float] = (0.5, 1.0)
    jitter: float = 0.005
    turn: Turn = 'so3'

    def __post_init__(self) -> None:
        for name in ('overlap', 'keep'):
            low, high = getattr(self, name)
            if not 0 < low <= high <= 1:
                raise ValueError(f'CropPairs.{name}: expected 0 < least <= greatest <= 1, got {low} and {high}')
        if self.points < 1 or self.jitter < 0 or self.turn not in get_args(Turn):
            raise ValueError(f'CropPairs: expected points >= 1, jitter >= 0 and turn of {get_args(Turn)}, got {self}')


class CropPair(NamedTuple):
    """Two crops of one scan.

    Attributes:
        rows: (n,) int64 the scan's points of the first crop, ascending.
        points: (n, 3 + channels) float32 the first crop, moved.
        viewpoint: (3,) where the scan was seen from (:func:`virtual_viewpoint`), moved along.
        view: The second crop, moved in its own way; its ids are rows of ``points``, -1 where the first has no copy.
    """

    rows: Int[np.ndarray, ' kept']
    points: Float[np.ndarray, 'kept channels']
    viewpoint: Float[np.ndarray, '3']
    view: View


def crop_pair(
    points: Float[np.ndarray, 'points channels'], settings: PairSettings, rng: np.random.Generator
) -> CropPair:
    """Take two balls of points about two points of a scan; thin, turn and jitter each by itself.

    An overlap is drawn first; the second centre is the one out of some, all of them in the first crop, whose ball comes
    nearest to it.

    Args:
        points: (n, 3 + channels) float32, metres first.
        settings: How they are taken.
        rng: The only source of chance.
    """
    count = max(1, min(settings.points, 2 * len(points) // 3))
    first = _ball(points, int(rng.integers(len(points))), count)
    second = _second_ball(points, first, rng.uniform(*settings.overlap), settings.overlap, rng)
    rows, others = (_thinned(crop, settings.keep, rng) for crop in (first, second))
    own_row = np.full(len(points), -1, dtype=np.int64)
    own_row[rows] = np.arange(len(rows))
    seen_from = virtual_viewpoint(points[:, :3])
    second_crop, second_eye = _moved(points[others], seen_from, settings, rng)
    view = View(second_crop, own_row[others], second_eye)
    return CropPair(rows, *_moved(points[rows], seen_from, settings, rng), view)


def overlap_of(first: Int[np.ndarray, ' first'], second: Int[np.ndarray, ' second']) -> float:
    """Share of the smaller crop's points that the other has, too."""
    return len(np.intersect1d(first, second, assume_unique=True)) / max(min(len(first), len(second)), 1)


def random_rotation(rng: np.random.Generator) -> Float[np.ndarray, '3 3']:
    """A rotation in space, all alike probable (from a random unit quaternion)."""
    w, x, y, z = (q := rng.standard_normal(4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _ball(points: np.ndarray, centre: int, count: int) -> Int[np.ndarray, ' rows']:
    """The so many points nearest to a point, ascending."""
    square = (points[:, :3].astype(np.float64) - points[centre, :3]) ** 2
    return np.sort(np.argpartition(square.sum(axis=1), count - 1)[:count])


def _second_ball(
    points: np.ndarray, first: np.ndarray, wanted: float, limits: tuple[float, float], rng: np.random.Generator
) -> Int[np.ndarray, ' rows']:
    balls = [_ball(points, int(centre), len(first)) for centre in rng.choice(first, min(CENTRES, len(first)), False)]
    shares = np.array([overlap_of(first, ball) for ball in balls])
    missed = np.abs(shares - wanted) + np.where((shares >= limits[0]) & (shares <= limits[1]), 0, 1)
    best = int(missed.argmin())
    return balls[best] if shares[best] >= limits[0] else first


def _thinned(rows: np.ndarray, keep: tuple[float, float], rng: np.random.Generator) -> Int[np.ndarray, ' kept']:
    return rows[random_subset(len(rows), max(1, round(rng.uniform(*keep) * len(rows))), rng)]


def _moved(
    points: np.ndarray, seen_from: np.ndarray, settings: PairSettings, rng: np.random.Generator
) -> tuple[Float[np.ndarray, 'n channels'], Float[np.ndarray, '3']]:
    """A crop about its own middle, turned, with noise; and the viewpoint, moved along."""
    out = points.copy()
    xyz = np.concatenate([points[:, :3].astype(np.float64), seen_from[None]])
    xyz -= xyz[:-1].mean(axis=0)
    if settings.turn == 'so3':
        xyz = xyz @ random_rotation(rng).T
    elif settings.turn == 'z':
        xyz = turned(xyz, rng.uniform(-np.pi, np.pi))
    noise = np.clip(rng.standard_normal((len(points), 3)), -3, 3) * settings.jitter
    out[:, :3] = xyz[:-1] + noise
    return out, xyz[-1]


@TRANSFORMS.register_module()
class CropPairs:
    """The scene becomes one crop of itself, and a second, overlapping one is appended to ``views``.

    The ids of that view say which of its points are copies of points of the first crop (-1: none), so correspondences
    are exact. Works on any data set without labels; belongs where AugmentedView would stand. The arguments are those of
    :class:`PairSettings`.
    """

    def __init__(self, **settings: Any) -> None:
        settings |= {name: tuple(settings[name]) for name in ('overlap', 'keep') if name in settings}
        self.settings = PairSettings(**settings)

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Take both by the item's generator.

        Raises:
            ValueError: A view was already taken.
        """
        pair = crop_pair(results['points'], self.settings, results['rng'])
        return select_points(results, pair.rows) | {
            'points': pair.points,
            'viewpoint': pair.viewpoint,
            'views': [pair.view],
        }
