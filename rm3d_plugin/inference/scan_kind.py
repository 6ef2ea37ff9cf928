"""What kind of scan it is: rooms, streets or airborne, from how its points lie."""

from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float

from rm3d_plugin.structures import PointCloud

Kind = Literal['rooms', 'streets', 'airborne']
KINDS: tuple[Kind, ...] = get_args(Kind)
ROOMY = 25.0  # m; a longer scan is a room only under a ceiling
COVERED = (
    0.5  # share of the plan under one ceiling, from which on a scan is indoors: .58 up on nine made-up rooms and a
)
# storey, at most .09 on 25 scans from the ground and from the air
CEILING = (1.8, 8.0)  # m above the floor at which a ceiling may be
SAME_LEVEL = 0.5  # m to either side
PLAN_CELL = 1.0  # m
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
        covered: Share of the plan that lies under one ceiling.
    """

    kind: Kind
    length: float
    evenness: float
    covered: float = 0.0

    def text(self) -> str:
        """The kind, and the reason.

        >>> ScanKind('rooms', 6.2, 0.31).text()
        'rooms: the scan is 6 m long, up to 25 m are'
        """
        if self.kind == 'rooms' and self.length > ROOMY:
            return (
                f'rooms: {100 * self.covered:.0f} % of the plan lies under one ceiling, from {100 * COVERED:.0f} % on'
            )
        even = f'points are spread over the plan with an evenness of {self.evenness:.2f}'
        return {
            'rooms': f'rooms: the scan is {self.length:.0f} m long, up to {ROOMY:.0f} m are',
            'streets': f'streets: the scan is {self.length:.0f} m long, and {even}; from the air it is {EVEN:g} up',
            'airborne': f'airborne: {even}, from {EVEN:g} on a scan is from the air',
        }[self.kind]


def scan_kind(cloud: PointCloud) -> ScanKind:
    """Tell the kind of a scan.

    What is small is a room, and what lies under one ceiling: a storey, a hall. Of what else is large, each square of
    the plan holds about as many points as another where it was seen from the air: the distance to the sensor hardly
    differs, and walls are hardly seen. A scanner that stands or drives has far more points near it and on walls.

    Args:
        cloud: At least one point, metres, z up.
    """
    plan = cloud.xyz[:, :2].astype(np.float64)
    low, high = np.percentile(plan, [OUTER, 100 - OUTER], axis=0)
    length = float((high - low).max())
    evenness = plan_evenness(plan, low, high)
    covered = share_covered(cloud.xyz, low, high)
    indoors = length <= ROOMY or covered >= COVERED
    kind: Kind = 'rooms' if indoors else 'airborne' if evenness >= EVEN else 'streets'
    return ScanKind(kind, length, evenness, covered)


def share_covered(
    xyz: Float[np.ndarray, 'points 3'], low: Float[np.ndarray, '2'], high: Float[np.ndarray, '2']
) -> float:
    """Share of the squares of the plan whose highest points lie at one level, that of a ceiling.

    The level is the median of the highest points, the floor that of the lowest; outdoors the two are hardly apart, or
    highest points lie at all heights.

    Args:
        xyz: Metres, z up.
        low: Corner of the rectangle that is looked at.
        high: The other corner.
    """
    inside = xyz[((xyz[:, :2] >= low) & (xyz[:, :2] <= high)).all(axis=1)]
    rows = np.floor((inside[:, :2] - low) / PLAN_CELL).astype(np.int64)
    square = rows[:, 0] * (rows[:, 1].max() + 1) + rows[:, 1]
    order = np.lexsort((inside[:, 2], square))
    ends = np.flatnonzero(np.diff(square[order], append=-1))
    top, bottom = inside[order][ends, 2], inside[order][np.r_[0, ends[:-1] + 1], 2]
    level, floor = np.median(top), np.median(bottom)
    if not CEILING[0] <= level - floor <= CEILING[1]:
        return 0.0
    return float((np.abs(top - level) <= SAME_LEVEL).mean())


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
