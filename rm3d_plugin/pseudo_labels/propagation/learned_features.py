"""What learned descriptors say of the points of a scan: some columns more that tell classes apart."""

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
from jaxtyping import Float

from rm3d_plugin.descriptors import LearnedDescriptor, PointSIFT, Semantic
from rm3d_plugin.ops.site_heights import with_heights
from rm3d_plugin.ops.site_histograms import with_histograms
from rm3d_plugin.ops.sites import Sites, voxel_sites
from rm3d_plugin.structures import PointCloud

HEARD: tuple[tuple[type[LearnedDescriptor], Callable[[Sites], Sites]], ...] = (
    (PointSIFT, lambda sites: sites),  # which place
    (Semantic, with_heights),  # which class of synthetic scans
)  # and what each sees beside the histograms of sites, which are made once for all
WIDTH = 32 * len(HEARD)  # values of a point
AT_ONCE = 8  # columns of all points that are held in memory


def learned_features(cloud: PointCloud) -> Iterator[Float[np.ndarray, 'points columns']]:
    """Descriptors of all points by each of :data:`HEARD`, some columns at a time.

    Their weights are those of the package, learnt from synthetic scans alone; their unit is the scan's own density.
    Points that they cannot describe have zeros. Normals of a file are not asked.

    Args:
        cloud: As given.
    """
    if not len(cloud):
        yield np.zeros((0, WIDTH), dtype=np.float32)
        return
    sites = with_histograms(voxel_sites(cloud.xyz), cloud.xyz)
    for descriptor, (_, seen) in zip(_descriptors(), HEARD, strict=True):
        described = descriptor.describe(seen(sites))
        rows = described.row_numbers()
        for first in range(0, described.source.shape[1], AT_ONCE):
            yield described.source[:, first : first + AT_ONCE][rows]


@cache
def _descriptors() -> tuple[LearnedDescriptor, ...]:
    return tuple(kind(kind.shipped()) for kind, _ in HEARD)
