"""Points as a person sees and touches them: colours, what a ray meets, what lies in a rectangle."""

from typing import Literal, NamedTuple, get_args

import matplotlib.path
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from matplotlib import colormaps
from matplotlib.colors import to_rgb

from rm3d_plugin.inference.label_scan import LabelledScan
from rm3d_plugin.structures import PointCloud
from rm3d_plugin.visualization.palette import GREY, region_colors

ColorBy = Literal['colour', 'intensity', 'height', 'class', 'confidence', 'region', 'check', 'difference']
COLOR_BY: tuple[ColorBy, ...] = get_args(ColorBy)
SHOWN = 400_000  # points of the picture, at most; labels are on all
REACH = 0.006  # of the distance from the eye: as near a ray must pass a point to meet it, beside the point's own size
BEHIND = 0.02  # of the distance: points so much behind the first in a cell of the picture are hidden
DARKEST = 0.5  # of a class's colour, on what is dark in the scan
CLEAR = 0.2  # of the way to the eye: so wide a tube, and from so far on, shall hold no point
SIGHT = 0.03  # of the way: a point, as it is drawn, so near to the line of sight hides what lies beyond, from BALL on
BALL = 0.05  # of the way
IN_CELL = 8  # points in a cell of the rectangle, about: the first of them hides the others


class Camera(NamedTuple):
    """Where the picture is taken from.

    Attributes:
        position: Metres, in the frame of the points.
        rotation: Columns are right, down and forward.
        fov: Vertical, radians.
        aspect: Width over height.
    """

    position: Float[np.ndarray, '3']
    rotation: Float[np.ndarray, '3 3']
    fov: float
    aspect: float


def colors_by(
    kind: ColorBy, cloud: PointCloud, labels: LabelledScan, class_colors: list[str]
) -> UInt8[np.ndarray, 'points 3']:
    """Colours of points; what a scan lacks is shown by height instead.

    Args:
        kind: What the colours tell; of a difference the labels hold only what would change. Of a check the confidence
            is that of the other labels, from red to blue, NaN where there is none.
        cloud: The scan.
        labels: Of its points.
        class_colors: ``#rrggbb`` of each class.
    """
    if kind in ('class', 'difference'):
        table = np.array([to_rgb(color) for color in [*class_colors, GREY]])  # the last, -1, is no class
        return _bytes(table[labels.semantic] * _shade(cloud))
    if kind == 'region':
        return _bytes(region_colors(labels.region) * _shade(cloud))
    if kind == 'confidence':
        return _mapped('magma', labels.confidence, 0.0, 1.0)
    if kind == 'check':
        seen = np.where(
            np.isnan(labels.confidence)[:, None], to_rgb(GREY), colormaps['RdYlBu'](labels.confidence)[:, :3]
        )
        return _bytes(seen * _shade(cloud))
    if kind == 'colour' and cloud.colors is not None:
        return _bytes(cloud.colors)
    if kind == 'intensity' and cloud.intensity is not None:
        return _mapped('cividis', cloud.intensity, *np.quantile(cloud.intensity, [0.01, 0.99]).tolist())
    return _mapped('viridis', cloud.xyz[:, 2], *np.quantile(cloud.xyz[:, 2], [0.01, 0.99]).tolist())


def point_hit(
    xyz: Float[np.ndarray, 'points 3'],
    origin: tuple[float, float, float],
    direction: tuple[float, float, float],
    size: float,
) -> int | None:
    """The first point that a ray meets; None where it meets none.

    Args:
        xyz: Points that are shown.
        origin: Of the ray, the eye.
        direction: Of the ray, of any length.
        size: Of a point, metres.
    """
    way = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    from_eye = xyz - np.asarray(origin, dtype=np.float64)
    ahead = from_eye @ way
    beside = np.sqrt(np.maximum(np.square(from_eye).sum(axis=1) - np.square(ahead), 0.0))
    met = (ahead > 0) & (beside <= size / 2 + REACH * ahead)
    if not met.any():
        return None
    rows = np.flatnonzero(met)
    first = ahead[rows].min()
    rows = rows[ahead[rows] <= first * (1.0 + BEHIND) + size]  # of what lies about as near, the one most on the ray
    return int(rows[beside[rows].argmin()])


def points_in_rectangle(
    xyz: Float[np.ndarray, 'points 3'], camera: Camera, low: tuple[float, float], high: tuple[float, float]
) -> Int[np.ndarray, ' inside']:
    """Points in a rectangle of the picture that no other point hides.

    Args:
        xyz: Points that are shown.
        camera: Of the picture.
        low: Upper left corner, both in [0, 1] from the upper left of the picture.
        high: Lower right corner.
    """
    place, depth = _projected(xyz, camera)
    rows = np.flatnonzero((depth > 0) & (place >= low).all(axis=1) & (place <= high).all(axis=1))
    return rows[_in_front(place[rows], depth[rows])]


def points_in_lasso(
    xyz: Float[np.ndarray, 'points 3'], camera: Camera, corners: Float[np.ndarray, 'corners 2']
) -> Int[np.ndarray, ' inside']:
    """Points in a polygon of the picture that no other point hides.

    Args:
        xyz: Points that are shown.
        camera: Of the picture.
        corners: At least three, in [0, 1] from the upper left of the picture.
    """
    place, depth = _projected(xyz, camera)
    rows = np.flatnonzero((depth > 0) & matplotlib.path.Path(corners).contains_points(place))
    return rows[_in_front(place[rows], depth[rows])]


def clearest_way(
    xyz: Float[np.ndarray, 'points 3'],
    place: Float[np.ndarray, '3'],
    before: Float[np.ndarray, '3'],
    length: float,
) -> Float[np.ndarray, '3']:
    """Direction from a place to an eye that sees it, with the fewest points between, near to that of before.

    From below only where the place is hidden from above.

    Args:
        xyz: Points that are shown.
        place: Looked at, metres.
        before: From it to the eye until now, of any length above 0.
        length: From it to the eye from now on, metres.
    """
    turns, lifts = np.deg2rad(np.arange(0.0, 360.0, 45.0)), np.deg2rad([20.0, 50.0, -20.0, -50.0])
    turn, lift = (each.ravel() for each in np.meshgrid(turns, lifts))
    ways = np.stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)], axis=1)
    own = before / np.linalg.norm(before)
    ways = np.concatenate([own[None], ways[np.argsort(-(ways @ own), kind='stable')]])
    away = xyz - place
    near = away[np.square(away).sum(axis=1) <= (1.2 * length) ** 2]
    between = []
    for way in ways:
        ahead = near @ way
        beside = np.square(near).sum(axis=1) - np.square(ahead)
        hidden = ((ahead > BALL * length) & (ahead < length) & (beside < (SIGHT * length) ** 2)).any()
        around = np.count_nonzero((ahead > CLEAR * length) & (beside < (CLEAR * length) ** 2))
        from_below = 0.5 * bool(way[2] < 0)
        between.append(around + len(near) * (bool(hidden) + from_below))
    return np.asarray(ways[int(np.argmin(between))])


def _projected(
    xyz: Float[np.ndarray, 'points 3'], camera: Camera
) -> tuple[Float[np.ndarray, 'points 2'], Float[np.ndarray, ' points']]:
    """Place in the picture, in [0, 1] from the upper left, and depth."""
    seen = (xyz - camera.position) @ camera.rotation
    depth = seen[:, 2]
    half = np.tan(camera.fov / 2) * np.where(depth > 0, depth, 1.0)
    return np.stack([0.5 + seen[:, 0] / (2 * half * camera.aspect), 0.5 + seen[:, 1] / (2 * half)], axis=1), depth


def _in_front(place: Float[np.ndarray, 'points 2'], depth: Float[np.ndarray, ' points']) -> Bool[np.ndarray, ' points']:
    if not len(place):
        return np.zeros(0, dtype=np.bool_)
    low, width = place.min(axis=0), np.maximum(np.ptp(place, axis=0), 1e-12)
    side = max(int(np.sqrt(len(place) / IN_CELL)), 1)
    column, row = np.minimum(side * (place - low) / width, side - 1).astype(np.int64).T
    nearest = np.full(side * side, np.inf)
    np.minimum.at(nearest, column * side + row, depth)
    return np.asarray(depth <= nearest[column * side + row] * (1.0 + BEHIND))


def _shade(cloud: PointCloud) -> Float[np.ndarray, 'points 1']:
    """Brightness by which surfaces of one class are still seen: that of the scan's own colours, or by height."""
    if cloud.colors is not None:
        bright = cloud.colors.mean(axis=1)
    else:
        bright = cloud.xyz[:, 2] if cloud.intensity is None else cloud.intensity
    low, high = np.quantile(bright, [0.02, 0.98])
    return np.asarray(DARKEST + (1.0 - DARKEST) * ((bright - low) / max(high - low, 1e-9)).clip(0.0, 1.0))[:, None]


def _mapped(name: str, values: Float[np.ndarray, ' points'], low: float, high: float) -> UInt8[np.ndarray, 'points 3']:
    shares = (values - low) / max(high - low, 1e-9)
    return np.asarray(colormaps[name](shares.clip(0.0, 1.0), bytes=True)[:, :3])


def _bytes(colors: Float[np.ndarray, 'points 3']) -> UInt8[np.ndarray, 'points 3']:
    return (255.0 * colors).round().astype(np.uint8)
