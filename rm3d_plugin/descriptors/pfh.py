"""Original point feature histograms: all pairs of the nearest points, with distance (METHOD 3, the baseline)."""

from typing import Any, final

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.descriptors.base import Descriptor, cloud_normals
from rm3d_plugin.ops.octree import Neighbors, Octree
from rm3d_plugin.ops.pair_features import ANGLE_BINS, DISTANCE_BINS, PairHistograms, histograms_of_points
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud

PRESETS: dict[str, dict[str, Any]] = {
    'indoor': {'k': 30},
    'lidar': {'k': 30},  # nearest points reach farther by themselves where points are few
}


def original_pfh(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    k: int = 30,
    distance_span: float | None = None,
    octree: Octree | None = None,
) -> PairHistograms:
    """The 625-bin histogram of theta, alpha, phi and distance over all pairs of the k nearest points.

    Args:
        points: (N, 3) metres.
        normals: (N, 3) unit normals; points with a zero normal are left out.
        k: Nearest points, the centre among them.
        distance_span: Metres at which the last distance bin ends. None scales distance by the neighbourhood's radius R:
            the bins divide [0, 2 R], the range that two points of a ball can have.
        octree: Over the same points, where there is one already.

    Returns:
        One row a point; not valid with fewer than three points or no pair that has a feature.
    """
    tree = Octree(points) if octree is None else octree

    def search(rows: Int[np.ndarray, ' some']) -> tuple[Neighbors, Float[np.ndarray, ' some']]:
        found = tree.knn(points[rows], min(k, len(points)))
        offsets = np.arange(len(rows) + 1, dtype=np.int64) * found.indices.shape[1]
        radii = np.sqrt(found.sq_dists[:, -1])
        spans = 2.0 * radii if distance_span is None else np.full(len(rows), distance_span)
        return Neighbors(found.indices.reshape(-1), offsets, found.sq_dists.reshape(-1)), spans

    return histograms_of_points(points, normals, tree, search, DISTANCE_BINS * ANGLE_BINS)


@final
@DESCRIPTORS.register_module()
class PFH(Descriptor):
    """Original PFH of every point, (N, 625) rows that sum to 1.

    Args:
        k: Nearest points that make a neighbourhood (larger: slower by its square, less noise).
        distance_span: Metres at which the last distance bin ends; None scales distance by the neighbourhood.
        normal_neighbors: Nearest points for normals where the cloud has none.

    Raises:
        ValueError: A number is out of range.
    """

    presets = PRESETS

    def __init__(self, k: int = 30, distance_span: float | None = None, normal_neighbors: int = 20) -> None:
        if k < 3 or (distance_span is not None and not distance_span > 0):
            raise ValueError(f'PFH: expected k >= 3 and distance_span > 0 or None, got {k} and {distance_span}')
        self.k = k
        self.distance_span = distance_span
        self.normal_neighbors = normal_neighbors

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud."""
        tree = Octree(cloud.xyz)
        normals = cloud_normals(cloud, self.normal_neighbors, tree)
        result = original_pfh(cloud.xyz, normals, self.k, self.distance_span, tree)
        return Descriptors(result.values, result.valid)
