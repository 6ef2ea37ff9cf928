"""How far up what boxes hold reaches."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


class BoxReach(NamedTuple):
    """How far up the points of boxes reach.

    Attributes:
        top: (M,) metres above the ground of the highest point, minus infinity without any.
        gap: (M,) metres, the widest gap between two points in height, those of the ground among them: what is higher by
            less may have been missed.
    """

    top: Float[np.ndarray, ' boxes']
    gap: Float[np.ndarray, ' boxes']


def box_reach(height: Float[np.ndarray, ' points'], owner: Int[np.ndarray, ' points'], count: int) -> BoxReach:
    """How far up the points of each box reach.

    Args:
        height: Metres above the ground.
        owner: Box of each point, -1 = none.
        count: Boxes.
    """
    order = np.lexsort((height, owner))
    order = order[owner[order] >= 0]
    of, up = owner[order], np.asarray(height, dtype=np.float64)[order]
    top, gap = np.full(count, -np.inf), np.zeros(count)
    np.maximum.at(top, of, up)
    np.maximum.at(gap, of[1:], np.where(of[1:] == of[:-1], np.diff(up), 0.0))
    return BoxReach(top, gap)
