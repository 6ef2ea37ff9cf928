"""What a learned descriptor says of the points of a scan: a few columns more that tell classes apart."""

from collections.abc import Iterator
from functools import cache

import numpy as np
from jaxtyping import Float

from rm3d_plugin.descriptors import Semantic
from rm3d_plugin.structures import PointCloud

WIDTH = 32  # values of a point
AT_ONCE = 8  # columns of all points that are held in memory


def learned_features(cloud: PointCloud) -> Iterator[Float[np.ndarray, 'points columns']]:
    """Descriptors of all points by :class:`~rm3d_plugin.descriptors.Semantic`, some columns at a time.

    Its weights are those of the package, learnt from the classes of synthetic scans alone; its unit is the scan's own
    density. Points that it cannot describe have zeros.

    Args:
        cloud: As given.
    """
    if not len(cloud):
        yield np.zeros((0, WIDTH), dtype=np.float32)
        return
    described = _descriptor().compute(cloud)
    rows = described.row_numbers()
    for first in range(0, WIDTH, AT_ONCE):
        yield described.source[:, first : first + AT_ONCE][rows]


@cache
def _descriptor() -> Semantic:
    return Semantic(Semantic.shipped())
