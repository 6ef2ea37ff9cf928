"""Fast point feature histograms (METHOD 3; Rusu et al., ICRA 2009)."""

from typing import Any, final

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.descriptors.base import Descriptor, cloud_normals, growing_radii
from rm3d_plugin.ops.fpfh import FastHistograms, fast_histograms
from rm3d_plugin.ops.octree import Neighbors, Octree
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud

PRESETS: dict[str, dict[str, Any]] = {
    'indoor': {'radius': 0.1},  # m; rooms at 1 to 5 cm between points
    'lidar': {'radius': 0.3, 'range_growth': 0.1},  # m; 0.3 m up to 10 m of range, 1.2 m at 40 m
}


def fpfh(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    radius: float | Float[np.ndarray, ' points'] | None = 0.1,
    max_neighbors: int | None = None,
    own_spfh: bool = False,
    octree: Octree | None = None,
) -> FastHistograms:
    """FPFH: for each point three histograms of 11 bins, of theta, alpha and phi.

    ``FPFH(p) = scale(sum over neighbours q of SPFH(q) / |q - p|^2)``, where SPFH(q) counts the pairs (q, neighbour of
    q) and ``scale`` makes each feature's bins sum to 100; see :func:`rm3d_plugin.ops.fpfh.fast_histograms`.

    Args:
        points: (N, 3) metres.
        normals: (N, 3) unit normals; points with a zero normal are left out.
        radius: Metres; one for all points or one each. None takes the nearest ``max_neighbors`` at any distance.
        max_neighbors: Keep the nearest so many points, the centre among them (ties: the lowest number); None keeps all.
        own_spfh: Add the point's own SPFH, so that each feature sums to 200: Open3D's reading, in which pairs of equal
            points have features of 0. PCL's leaves both out.
        octree: Over the same points, where there is one already.

    Returns:
        One row a point; not valid where no neighbour has a histogram.

    Raises:
        ValueError: Neither ``radius`` nor ``max_neighbors`` is given.
    """
    if radius is None and max_neighbors is None:
        raise ValueError('fpfh: expected radius (metres) or max_neighbors, got neither')
    tree = Octree(points) if octree is None else octree
    reach = None if radius is None else np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(points),))

    def search(rows: Int[np.ndarray, ' some']) -> Neighbors:
        if reach is not None:
            return tree.radius(points[rows], reach[rows], max_neighbors, ordered=False)
        found = tree.knn(points[rows], min(max_neighbors or 1, len(points)))
        offsets = np.arange(len(rows) + 1, dtype=np.int64) * found.indices.shape[1]
        return Neighbors(found.indices.reshape(-1), offsets, found.sq_dists.reshape(-1))

    return fast_histograms(points, normals, tree, search, own_spfh)


@final
@DESCRIPTORS.register_module()
class FPFH(Descriptor):
    """FPFH of every point, (N, 33) rows of percentages; each feature's 11 bins sum to 100 (200 with ``own_spfh``).

    The cost is linear in the neighbours: about 0.1 us a neighbour on one core, the search included.

    Args:
        radius: Metres (larger: coarser surface detail); None takes the nearest ``max_neighbors`` at any distance.
        max_neighbors: The nearest so many points are used, the centre among them; None uses all within ``radius``.
        own_spfh: Add the point's own histogram: Open3D's values. Without it: PCL's.
        normal_neighbors: Nearest points for normals where the cloud has none.
        range_growth: Per metre; the radius is multiplied by max(1, range_growth * distance to the sensor), or to the
            local origin where no sensor is known. 0 keeps it the same everywhere.

    Raises:
        ValueError: A number is out of range.
    """

    presets = PRESETS
    version = 2

    def __init__(
        self,
        radius: float | None = 0.1,
        max_neighbors: int | None = None,
        own_spfh: bool = False,
        normal_neighbors: int = 20,
        range_growth: float = 0.0,
    ) -> None:
        if (radius is not None and not radius > 0) or not range_growth >= 0:
            raise ValueError(f'FPFH: expected radius > 0 and range_growth >= 0, got {radius} and {range_growth}')
        if max_neighbors is None and radius is None or max_neighbors is not None and max_neighbors < 2:
            raise ValueError(f'FPFH: expected max_neighbors >= 2 (None with a radius only), got {max_neighbors}')
        self.radius = radius
        self.max_neighbors = max_neighbors
        self.own_spfh = own_spfh
        self.normal_neighbors = normal_neighbors
        self.range_growth = range_growth

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud."""
        tree = Octree(cloud.xyz)
        normals = cloud_normals(cloud, self.normal_neighbors, tree)
        radii = None if self.radius is None else growing_radii(cloud, self.radius, self.range_growth)
        result = fpfh(cloud.xyz, normals, radii, self.max_neighbors, self.own_spfh, tree)
        return Descriptors(result.values, result.valid)
