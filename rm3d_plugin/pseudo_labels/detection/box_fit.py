"""A box of known size from the few faces that a sensor saw (METHOD 7, pseudo boxes)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

SOLID_WIDTH = 1.0  # m; people and cyclists are narrower, and a lidar sees around and through them
STRAY_SHARE = 0.02  # share of the points at either end that may be strays
STRAY_GAP = 0.2  # m; how far apart they then lie
GRID_STEP = np.deg2rad(2.0)  # coarse search over a quarter turn
FINE_STEPS = 9  # refinement within one coarse step to either side
MAX_POINTS = 2048  # points that vote for an angle; more cost time and change little
TRUNCATION = 0.3  # m; a point farther from every visible face (roof, mirror, stray) says nothing
EXCESS_WEIGHT = 1.0  # cost of each metre by which the points exceed the size
MISSING_WEIGHT = 0.1  # cost of each metre of a face that should be seen and is not


class Footprint(NamedTuple):
    """A rectangle seen from above.

    Attributes:
        center: (2,) metres.
        size: (2,) length along the yaw and width, metres.
        yaw: Radians in [-pi/2, pi/2): which of the two ends is the front cannot be known.
        span: (2,) what the points themselves extend along the same axes, metres.
        cost: Mean distance of the points to the visible faces plus penalties, metres; smaller is better.
    """

    center: Float[np.ndarray, '2']
    size: Float[np.ndarray, '2']
    yaw: float
    span: Float[np.ndarray, '2']
    cost: float


class _Frames(NamedTuple):
    """Points and sensor in the axes of each candidate angle."""

    u: np.ndarray  # (angles, points)
    v: np.ndarray
    sensor_u: np.ndarray  # (angles,)
    sensor_v: np.ndarray


def _frames(xy: np.ndarray, sensor: np.ndarray, angles: np.ndarray) -> _Frames:
    c, s = np.cos(angles), np.sin(angles)
    return _Frames(
        c[:, None] * xy[:, 0] + s[:, None] * xy[:, 1],
        c[:, None] * xy[:, 1] - s[:, None] * xy[:, 0],
        c * sensor[0] + s * sensor[1],
        c * sensor[1] - s * sensor[0],
    )


def _ends(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the points of each row begin and end; a few strays that lie apart from the others do not count."""
    last = values.shape[1] - 1
    strays = min(int(np.ceil(STRAY_SHARE * last)), last // 2)
    parts = np.partition(values, (0, strays, last - strays, last), axis=1)
    low, inner_low, inner_high, high = parts[:, 0], parts[:, strays], parts[:, last - strays], parts[:, last]
    return (
        np.where(inner_low - low > STRAY_GAP, inner_low, low),
        np.where(high - inner_high > STRAY_GAP, inner_high, high),
    )


def _place(
    low: np.ndarray, high: np.ndarray, sensor: np.ndarray, length: float, solid: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Start and end of an interval of at least ``length`` that holds the points.

    What is missing to that length is hidden behind a solid object; it is missing on both sides of a slender one, and
    where the sensor is between the two ends.
    """
    size = np.maximum(length, high - low)
    slack = size - (high - low)
    start = low - slack / 2
    if solid:
        start = np.where(sensor < low, low, np.where(sensor > high, low - slack, start))
    return start, start + size


def _to_faces(values: np.ndarray, start: np.ndarray, end: np.ndarray, sensor: np.ndarray) -> np.ndarray:
    """Distance to the face that looks at the sensor; infinite where the sensor is between the two faces.

    Where nobody knows the sensor (NaN), the nearer of both faces counts.
    """
    if np.isnan(sensor).any():
        return np.asarray(np.minimum(np.abs(values - start[:, None]), np.abs(values - end[:, None])))
    near = np.where(sensor < start, start, np.where(sensor > end, end, np.inf))
    return np.abs(values - near[:, None])


def _costs(frames: _Frames, length: float, width: float, solid: bool) -> np.ndarray:
    """Cost of each angle for a rectangle with its length along u."""
    (low_u, high_u), (low_v, high_v) = _ends(frames.u), _ends(frames.v)
    start_u, end_u = _place(low_u, high_u, frames.sensor_u, length, solid)
    start_v, end_v = _place(low_v, high_v, frames.sensor_v, width, solid)
    distance = np.minimum(
        _to_faces(frames.u, start_u, end_u, frames.sensor_u), _to_faces(frames.v, start_v, end_v, frames.sensor_v)
    )
    fit = np.minimum(distance, TRUNCATION).mean(axis=1)
    span_u, span_v = high_u - low_u, high_v - low_v
    excess = np.maximum(span_u - length, 0) + np.maximum(span_v - width, 0)
    # A face along u is seen under the angle that the sensor makes with its normal, v.
    away_u, away_v = frames.sensor_u - (start_u + end_u) / 2, frames.sensor_v - (start_v + end_v) / 2
    reach = np.hypot(away_u, away_v) + 1e-9
    seen_u, seen_v = (np.where(np.isnan(away), 1.0, np.abs(away) / reach) for away in (away_v, away_u))
    missing = np.maximum(length - span_u, 0) * seen_u + np.maximum(width - span_v, 0) * seen_v
    return fit + EXCESS_WEIGHT * excess + MISSING_WEIGHT * missing


def fit_footprint(
    xy: Float[np.ndarray, 'points 2'],
    size: Float[np.ndarray, '2'] | tuple[float, float],
    sensor: Float[np.ndarray, '2'] | tuple[float, float] | None = (0.0, 0.0),
) -> Footprint:
    """The rectangle of a known size whose sides that face the sensor explain the points best.

    For each angle the rectangle touches the points on the sensor's side and extends away from it; the angle, and which
    axis is the length, are those of the least cost. Deterministic: a fixed grid of angles, refined once, ties to the
    smaller angle.

    Args:
        xy: Points from above, metres; at least one.
        size: Length and width to complete to, metres.
        sensor: Position of the sensor, metres; None: nobody knows, the points lie on all sides.
    """
    xy = np.asarray(xy, dtype=np.float64)
    if len(xy) == 0:
        raise ValueError('fit_footprint: expected at least one point')
    length, width = float(size[0]), float(size[1])
    solid = min(length, width) >= SOLID_WIDTH
    where = np.asarray((np.nan, np.nan) if sensor is None else sensor, dtype=np.float64)
    middle = xy.mean(axis=0)
    points, where = xy - middle, where - middle
    voters = points[:: -(-len(points) // MAX_POINTS)]
    grid = np.arange(0.0, np.pi, GRID_STEP)
    costs = _costs(_frames(voters, where, grid), length, width, solid)
    best = grid[int(costs.argmin())]
    fine = best + np.linspace(-GRID_STEP, GRID_STEP, 2 * FINE_STEPS + 1)
    costs = _costs(_frames(voters, where, fine), length, width, solid)
    pick = int(costs.argmin())
    angle = np.array([fine[pick]])
    frames = _frames(points, where, angle)
    (low_u, high_u), (low_v, high_v) = _ends(frames.u), _ends(frames.v)
    start_u, end_u = (edge[0] for edge in _place(low_u, high_u, frames.sensor_u, length, solid))
    start_v, end_v = (edge[0] for edge in _place(low_v, high_v, frames.sensor_v, width, solid))
    u, v = (start_u + end_u) / 2, (start_v + end_v) / 2
    c, s = np.cos(angle[0]), np.sin(angle[0])
    center = middle + np.array([c * u - s * v, s * u + c * v])
    yaw = (angle[0] + np.pi / 2) % np.pi - np.pi / 2
    span = np.array([high_u[0] - low_u[0], high_v[0] - low_v[0]])
    return Footprint(center, np.array([end_u - start_u, end_v - start_v]), float(yaw), span, float(costs[pick]))
