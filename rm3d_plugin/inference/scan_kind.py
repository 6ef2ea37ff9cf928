"""What kind of scan it is: rooms, streets or airborne, from how its points lie."""

from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float

from rm3d_plugin.structures import PointCloud

Kind = Literal['rooms', 'streets', 'airborne']
KINDS: tuple[Kind, ...] = get_args(Kind)
ROOMY = 25.0  # m; a longer scan is no room
EVEN = 0.65  # from here on a scan was seen from the air: .92 on an aerial tile, at most .46 on 31 scans from the ground
SQUARE_POINTS = 32  # of the squares whose points are counted, on average over the bounding box: chance moves it by 3 %
SHORTEST = 1e-6  # m; a square's edge where all points are in one place
OUTER = 1.0  # percent of the points on each side that do not count: strays


class ScanKind(NamedTuple):
    """A kind, and what was measured.

    Attributes:
        kind: ``rooms``, ``streets`` (a lidar on the ground or on a car) or ``airborne``.
        length: Metres, the longer side of the scan's bounding rectangle, without the outermost points.
        evenness: 1: as many points on every square of the plan; 1 / n: all on one of n squares.
    """

    kind: Kind
    length: float
    evenness: float

    def text(self) -> str:
        """The kind, and the reason.

        >>> ScanKind('rooms', 6.2, 0.31).text()
        'rooms: the scan is 6 m long, up to 25 m are'
        """
        even = f'points are spread over the plan with an evenness of {self.evenness:.2f}'
        return {
            'rooms': f'rooms: the scan is {self.length:.0f} m long, up to {ROOMY:.0f} m are',
            'streets': f'streets: the scan is {self.length:.0f} m long, and {even}; from the air it is {EVEN:g} up',
            'airborne': f'airborne: {even}, from {EVEN:g} on a scan is from the air',
        }[self.kind]


def scan_kind(cloud: PointCloud) -> ScanKind:
    """Tell the kind of a scan.

    What is small is a room. Of what is large, each square of the plan holds about as many points as another where it
    was seen from the air: the distance to the sensor hardly differs, and walls are hardly seen. A scanner that stands
    or drives has far more points near it and on walls.

    Args:
        cloud: At least one point, metres, z up.
    """
    plan = cloud.xyz[:, :2].astype(np.float64)
    low, high = np.percentile(plan, [OUTER, 100 - OUTER], axis=0)
    length = float((high - low).max())
    evenness = plan_evenness(plan, low, high)
    kind: Kind = 'rooms' if length <= ROOMY else 'airborne' if evenness >= EVEN else 'streets'
    return ScanKind(kind, length, evenness)


def plan_evenness(
    plan: Float[np.ndarray, 'points 2'], low: Float[np.ndarray, '2'], high: Float[np.ndarray, '2']
) -> float:
    """Jain's index of the points on the squares that hold any: (sum n)^2 / (squares * sum n^2).

    >>> grid = np.stack(np.meshgrid(np.arange(64.0), np.arange(64.0)), axis=-1).reshape(-1, 2)
    >>> round(plan_evenness(grid, np.zeros(2), np.full(2, 63.0)), 1)
    0.9

    Args:
        plan: Metres.
        low: Corner of the rectangle that is looked at.
        high: The other corner.
    """
    share = SQUARE_POINTS / len(plan)
    edge = max(float(np.sqrt(np.prod(high - low) * share)), float((high - low).max()) * share, SHORTEST)
    inside = plan[((plan >= low) & (plan <= high)).all(axis=1)] - low
    rows = np.floor(inside / edge).astype(np.int64)
    _, counts = np.unique(rows[:, 0] * (rows[:, 1].max() + 1) + rows[:, 1], return_counts=True)
    return float(counts.sum() ** 2 / (len(counts) * np.square(counts, dtype=np.float64).sum()))
