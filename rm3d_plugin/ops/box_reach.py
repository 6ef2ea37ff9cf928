"""How far up what boxes hold reaches."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


class BoxReach(NamedTuple):
    """How far up the points of boxes reach.

    Attributes:
        top: (M,) metres above the ground of the highest point, minus infinity without any.
        gap: (M,) metres, the widest gap in height between two points, or between the lowest and the ground: what is
            higher by less may have been missed.
    """

    top: Float[np.ndarray, ' boxes']
    gap: Float[np.ndarray, ' boxes']


def box_reach(
    height: Float[np.ndarray, ' points'], owner: Int[np.ndarray, ' points'], count: int, ground: float = 0.0
) -> BoxReach:
    """How far up the points of each box reach.

    Args:
        height: Metres above the ground.
        owner: Box of each point, -1 = none.
        count: Boxes.
        ground: Metres up to which points may have been taken away as ground.
    """
    own = np.flatnonzero(owner >= 0)
    order = own[np.lexsort((height[own], owner[own]))]
    of, up = owner[order], np.asarray(height, dtype=np.float64)[order]
    top, gap = np.full(count, -np.inf), np.zeros(count)
    np.maximum.at(top, of, up)
    first = np.append(True, of[1:] != of[:-1])[: len(of)]
    np.maximum.at(gap, of, np.where(first, up - ground, np.diff(up, prepend=0.0)))
    return BoxReach(top, gap)
