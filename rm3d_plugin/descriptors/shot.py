"""Signatures of histograms of orientations, 352 values (METHOD 3; Tombari, Salti, Di Stefano, ECCV 2010)."""

from typing import Any, Literal, final, get_args

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.descriptors.base import Descriptor, cloud_normals, growing_radii
from rm3d_plugin.ops.octree import Neighbors, Octree
from rm3d_plugin.ops.shot import Signatures, shot_signatures
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import Descriptors, PointCloud

Norm = Literal['l1', 'l2']

PRESETS: dict[str, dict[str, Any]] = {
    'indoor': {'radius': 0.1},  # m; rooms at 1 to 5 cm between points
    'lidar': {'radius': 0.3, 'range_growth': 0.1},  # m; 0.3 m up to 10 m of range, 1.2 m at 40 m
}


def shot(
    points: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    radius: float | Float[np.ndarray, ' points'] = 0.1,
    norm: Norm = 'l1',
    max_neighbors: int | None = None,
    octree: Octree | None = None,
) -> Signatures:
    """SHOT: cosines between normals and the local z axis, in 32 volumes of a ball aligned with its own frame.

    The frame (x, y, z) of a point p comes from ``M = sum (R - d_i) (p_i - p)(p_i - p)^T / sum (R - d_i)``: x has the
    largest eigenvalue, z the smallest, each towards the side with most points (tie: the five around the median
    distance), y = z x x. The ball has 8 azimuth sectors, 2 shells (split at R / 2) and 2 halves; each volume holds 11
    bins of cos(n_i, z). A neighbour is shared, in each of the four directions apart, between its own bin and the next
    by distance from the bin centres. Values equal PCL's, whose last cosine bin wraps when cosines in (0.8, 0.9) are
    shared.

    Args:
        points: (N, 3) metres.
        normals: (N, 3) unit normals; points with a zero normal shape the frames alone.
        radius: R in metres; one for all points or one each.
        norm: ``'l1'``: a signature sums to 1 (the paper); ``'l2'``: its squares do (PCL).
        max_neighbors: Keep the nearest so many points, the centre among them (ties: the lowest number); None keeps all.
        octree: Over the same points, where there is one already.

    Returns:
        One row a point with its frame; not valid with fewer than five neighbours or all of them on one line.

    Raises:
        ValueError: ``norm`` is neither.
    """
    if norm not in get_args(Norm):
        raise ValueError(f'shot: norm: expected one of {list(get_args(Norm))}, got {norm!r}')
    tree = Octree(points) if octree is None else octree
    radii = np.array(np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(points),)))

    def search(rows: Int[np.ndarray, ' some']) -> tuple[Neighbors, Float[np.ndarray, ' some']]:
        return tree.radius(points[rows], radii[rows], max_neighbors), radii[rows]

    return shot_signatures(points, normals, tree, search, norm == 'l2')


@final
@DESCRIPTORS.register_module()
class SHOT(Descriptor):
    """SHOT of every point, (N, 352) rows without unit.

    The cost is linear in the neighbours: about 0.2 us a neighbour on one core, the search included; 1.4 kB a point.

    Args:
        radius: Metres (larger: coarser surface detail).
        norm: ``'l1'``: rows sum to 1 (the paper); ``'l2'``: their squares do (PCL).
        max_neighbors: The nearest so many points are used, the centre among them; None uses all.
        normal_neighbors: Nearest points for normals where the cloud has none.
        range_growth: Per metre; the radius is multiplied by max(1, range_growth * distance to the sensor), or to the
            local origin where no sensor is known. 0 keeps it the same everywhere.

    Raises:
        ValueError: A number is out of range, or ``norm`` is neither.
    """

    presets = PRESETS

    def __init__(
        self,
        radius: float = 0.1,
        norm: Norm = 'l1',
        max_neighbors: int | None = None,
        normal_neighbors: int = 20,
        range_growth: float = 0.0,
    ) -> None:
        if not radius > 0 or not range_growth >= 0:
            raise ValueError(f'SHOT: expected radius > 0 and range_growth >= 0, got {radius} and {range_growth}')
        if norm not in get_args(Norm):
            raise ValueError(f'SHOT: norm: expected one of {list(get_args(Norm))}, got {norm!r}')
        self.radius = radius
        self.norm: Norm = norm
        self.max_neighbors = max_neighbors
        self.normal_neighbors = normal_neighbors
        self.range_growth = range_growth

    def compute(self, cloud: PointCloud) -> Descriptors:
        """Describe every point of a cloud."""
        tree = Octree(cloud.xyz)
        normals = cloud_normals(cloud, self.normal_neighbors, tree)
        radii = growing_radii(cloud, self.radius, self.range_growth)
        result = shot(cloud.xyz, normals, radii, self.norm, self.max_neighbors, tree)
        return Descriptors(result.values, result.valid)
