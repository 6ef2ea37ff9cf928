"""Further views of a scene, which the consistency loss compares with the first (METHOD 7, L_Aug)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import map_coordinates, uniform_filter

from rm3d_plugin.datasets.transforms.geometric import turned
from rm3d_plugin.datasets.transforms.points import crop_rows, random_subset
from rm3d_plugin.registry import TRANSFORMS

Wave = tuple[float, float]
_GREY = 0.5  # no colour, to the network
_RGB_OF = {6: slice(3, 6), 7: slice(4, 7)}  # columns of points with colour: x, y, z, (intensity,) r, g, b


def rgb_columns(points: Float[np.ndarray, 'points channels']) -> slice | None:
    """Where the colours stand among the columns of points; None where the scan has none."""
    return _RGB_OF.get(points.shape[1])


@dataclass(frozen=True, eq=False)
class View:
    """Another view of the same points, or of some of them and others.

    Attributes:
        points: (m, 3 + channels) float32.
        point_ids: (m,) int64; row ``i`` is a copy of row ``point_ids[i]`` of the first view; -1: of none.
        viewpoint: (3,) where the scan was seen from, in the coordinates of the view, or None.
    """

    points: Float[np.ndarray, 'kept channels']
    point_ids: Int[np.ndarray, ' kept']
    viewpoint: Float[np.ndarray, '3'] | None = None


@dataclass(frozen=True)
class ViewSettings:
    """How far the second view strays from the first; METHOD 7 gives the numbers.

    Attributes:
        rot: Least and greatest turn about z, radians.
        flip_prob: Chance to mirror x, and the same for y.
        scale: Least and greatest factor.
        jitter: Standard deviation of each coordinate's noise, metres; cut off at three times that.
        keep: Least and greatest share of points that stay.
        elastic: (grid cell, greatest shift) in metres, or several such waves, or None; warps objects smoothly.
        channel_jitter: Standard deviation of one shift and one factor for intensity and colour; results are clipped
            to [0, 1].
        channel_noise: Standard deviation of each point's own shift of intensity and colour.
        color_drop: Chance that the view is grey.
        prob: Chance that a scene gets a second view; the others get one without points, and a batch of those alone has
            no consistency loss. Smaller: faster, as the view costs nearly another step.
        crop: Least and greatest share of the points that stand around a random one, seen from above, before points are
            thinned out; None: all. The view then lacks the surroundings of its border.
    """

    rot: tuple[float, float] = (-np.pi, np.pi)
    flip_prob: float = 0.5
    scale: tuple[float, float] = (0.9, 1.1)
    jitter: float = 0.005
    keep: tuple[float, float] = (0.5, 0.8)
    elastic: Wave | tuple[Wave, ...] | None = None
    channel_jitter: float = 0.05
    channel_noise: float = 0.0
    color_drop: float = 0.0
    prob: float = 1.0
    crop: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name, least in (('rot', -np.inf), ('scale', 0.0), ('keep', 0.0), ('crop', 0.0)):
            low, high = getattr(self, name) or (1.0, 1.0)
            if not least < low <= high:
                raise ValueError(f'AugmentedView.{name}: expected least then greatest above {least}, got {low}, {high}')
        shares, deviations = (
            (self.flip_prob, self.color_drop, self.prob),
            (self.jitter, self.channel_jitter, self.channel_noise),
        )
        if (
            max(self.keep[1], (self.crop or self.keep)[1]) > 1
            or min(shares) < 0
            or max(shares) > 1
            or min(deviations) < 0
        ):
            raise ValueError(f'AugmentedView: a share lies outside [0, 1] or a deviation below 0 in {self}')
        if any(len(wave) != 2 or min(wave) <= 0 for wave in self.waves):
            raise ValueError(f'AugmentedView.elastic: expected two lengths in metres, got {self.elastic}')

    @property
    def waves(self) -> tuple[Wave, ...]:
        """The elastic waves, each a grid cell and a greatest shift in metres."""
        if not self.elastic:
            return ()
        many: Any = self.elastic if isinstance(self.elastic[0], (tuple, list)) else (self.elastic,)
        return tuple(many)


def augmented_view(
    points: Float[np.ndarray, 'points channels'], settings: ViewSettings, rng: np.random.Generator
) -> View:
    """Take a second view: thin out, warp, turn about the middle, mirror, scale, jitter.

    Args:
        points: (n, 3 + channels) float32: metres, then channels in [0, 1].
        settings: How far it may stray.
        rng: The only source of chance.

    Returns:
        At least one point, where there is one.
    """
    there = np.arange(len(points)) if settings.crop is None else random_crop(points, settings.crop, rng)
    kept = max(1, round(rng.uniform(*settings.keep) * len(there))) if len(there) else 0
    index = there[random_subset(len(there), kept, rng)]
    view = points[index].copy()
    xyz = view[:, :3].astype(np.float64)
    middle = np.zeros(3) if len(xyz) == 0 else 0.5 * (xyz.min(axis=0) + xyz.max(axis=0))
    for cell, magnitude in settings.waves:
        xyz = xyz + elastic_shift(xyz, cell, magnitude, rng)
    xyz = turned(xyz - middle, rng.uniform(*settings.rot))
    xyz[:, :2] *= np.where(rng.random(2) < settings.flip_prob, -1.0, 1.0)
    xyz *= rng.uniform(*settings.scale)
    noise = np.clip(rng.standard_normal(xyz.shape), -3, 3) * settings.jitter
    view[:, :3] = xyz + noise + middle
    if view.shape[1] > 3:
        shift, factor = rng.normal(0.0, settings.channel_jitter, size=(2, view.shape[1] - 3))
        view[:, 3:] = np.clip(view[:, 3:] * (1 + factor) + shift, 0.0, 1.0)
        _spoil_channels(view, settings, rng)
    return View(view, index)


def random_crop(
    points: Float[np.ndarray, 'points channels'], share: tuple[float, float], rng: np.random.Generator
) -> Int[np.ndarray, ' kept']:
    """Rows of a share of the points, those nearest to a random one as seen from above; at least one, ascending."""
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64)
    most = max(1, round(rng.uniform(*share) * len(points)))
    center = points[rng.integers(len(points)), :3].astype(np.float64)
    return crop_rows(points[:, :3], center, most, 'column')


def _spoil_channels(view: Float[np.ndarray, 'kept channels'], settings: ViewSettings, rng: np.random.Generator) -> None:
    """Noise on each value, or no colour at all, in place; what is switched off draws no numbers."""
    if settings.channel_noise > 0:
        noise = rng.normal(0.0, settings.channel_noise, (len(view), view.shape[1] - 3))
        view[:, 3:] = np.clip(view[:, 3:] + noise, 0.0, 1.0)
    columns = rgb_columns(view)
    if settings.color_drop > 0 and rng.random() < settings.color_drop and columns is not None:
        view[:, columns] = _GREY


def elastic_shift(
    xyz: Float[np.ndarray, 'points 3'], cell: float, magnitude: float, rng: np.random.Generator
) -> Float[np.ndarray, 'points 3']:
    """Smooth random shifts: noise on a coarse grid, blurred, and read between its nodes.

    Args:
        xyz: (n, 3) metres.
        cell: Grid spacing in metres; larger: gentler waves. Raised where the grid would exceed 64 nodes a side.
        magnitude: Greatest shift along an axis, metres.
        rng: Source of the noise.
    """
    if len(xyz) == 0:
        return np.zeros((0, 3))
    low, span = xyz.min(axis=0), np.ptp(xyz, axis=0)
    cells = np.maximum(cell, span / 60)
    shape = tuple((span / cells).astype(int) + 3)
    at = ((xyz - low) / cells + 0.5).T
    shifts = np.empty(xyz.shape)
    for axis in range(3):
        noise = rng.uniform(-1.0, 1.0, size=shape)
        for _ in range(2):
            noise = uniform_filter(noise, size=3, mode='nearest')
        shifts[:, axis] = map_coordinates(noise / np.abs(noise).max(), at, order=1, mode='nearest')
    return shifts * magnitude


@TRANSFORMS.register_module()
class AugmentedView:
    """Appends a :class:`View` to the list ``views``; several of these transforms make several views.

    Comes last before PackScene. The arguments are those of :class:`ViewSettings`.
    """

    def __init__(self, **settings: Any) -> None:
        self.settings = ViewSettings(**settings)

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Take the view by the item's generator."""
        points, rng, prob = results['points'], results['rng'], self.settings.prob
        if prob < 1 and rng.random() >= prob:
            view = View(points[:0].copy(), np.zeros(0, dtype=np.int64))
        else:
            view = augmented_view(points, self.settings, rng)
        return results | {'views': [*results.get('views', ()), view]}
