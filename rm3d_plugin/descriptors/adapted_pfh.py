"""Adapted point feature histograms: all pairs within a radius, without distance (METHOD 3)."""

from typing import Any, final

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.descriptors.base import Descriptor, cloud_normals, growing_radii
from rm3d_plugin.ops.octree import Neighbors, Octree
from rm3d_plugin.ops.pair_features import ANGLE_BINS, PairHistograms, histograms_of_points
from rm3d_plugin.ops.shared_octree import octree_of
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud

PRESETS: dict[str, dict[str, Any]] = {
    'indoor': {'radius': 0.1},  # m; rooms at 1 to 5 cm between points
    'lidar': {'radius': 0.3, 'range_growth': 0.1},  # m; 0.3 m up to 10 m of range, 1.2 m at 40 m
}


def adapted_pfh(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    radius: float | Float[np.ndarray, ' points'],
    max_neighbors: int | None = 48,
    octree: Octree | None = None,
) -> PairHistograms:
    """The 125-bin histogram of theta, alpha and phi over all pairs within a radius, the centre among them.

    Args:
        points: (N, 3) metres.
        normals: (N, 3) unit normals; points with a zero normal are left out.
        radius: Metres; one for all points or one each.
        max_neighbors: Keep the nearest so many points, the centre among them (ties: the lowest number); None keeps all.
        octree: Over the same points, where there is one already.

    Returns:
        One row a point; not valid with fewer than three points or no pair that has a feature.
    """
    tree = Octree(points) if octree is None else octree
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(points),))

    def search(rows: Int[np.ndarray, ' some']) -> tuple[Neighbors, None]:
        return tree.radius(points[rows], radii[rows], max_neighbors), None

    return histograms_of_points(points, normals, tree, search, ANGLE_BINS)


@final
@DESCRIPTORS.register_module()
class AdaptedPFH(Descriptor):
    """Adapted PFH of every point, (N, 125) rows that sum to 1.

    Args:
        radius: Metres (larger: coarser surface detail, more pairs).
        max_neighbors: The nearest so many points are used (larger: slower by its square, less noise); None uses all.
        normal_neighbors: Nearest points for normals where the cloud has none.
        range_growth: Per metre; the radius is multiplied by max(1, range_growth * distance to the sensor), or to the
            local origin where no sensor is known. 0 keeps it the same everywhere.

    Raises:
        ValueError: A number is out of range.
    """

    presets = PRESETS

    def __init__(
        self,
        radius: float = 0.1,
        max_neighbors: int | None = 48,
        normal_neighbors: int = 20,
        range_growth: float = 0.0,
    ) -> None:
        if not radius > 0 or not range_growth >= 0:
            raise ValueError(f'AdaptedPFH: expected radius > 0 and range_growth >= 0, got {radius} and {range_growth}')
        self.radius = radius
        self.max_neighbors = max_neighbors
        self.normal_neighbors = normal_neighbors
        self.range_growth = range_growth

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud."""
        tree = octree_of(cloud.xyz)
        normals = cloud_normals(cloud, self.normal_neighbors, tree)
        radii = growing_radii(cloud, self.radius, self.range_growth)
        result = adapted_pfh(cloud.xyz, normals, radii, self.max_neighbors, tree)
        return Descriptors(result.values, result.valid)
