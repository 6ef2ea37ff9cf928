"""How densely a scan was taken: the unit in which learned descriptors see it, whatever the sensor."""

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.octree import Octree

SAMPLE = 50_000  # points whose neighbours are looked up; all of them in smaller scans


def scan_spacing(xyz: Float[np.ndarray, 'points 3'], neighbors: int = 16, octree: Octree | None = None) -> float:
    """Distance between points on the surfaces of a scan, metres.

    A surface of points ``s`` apart has ``pi r^2 / s^2`` of them within ``r``, so the k-th nearest tells ``s`` as
    ``d_k sqrt(pi / k)``; the median over the points is taken. With k = 16 the rings of a spinning lidar count as what
    they are, not the points within a ring. Moving the scan or changing the order of its points changes rounding alone.

    Args:
        xyz: (N, 3) metres.
        neighbors: k, without the point itself; fewer where there are fewer points.
        octree: Over the same points, where there is one already.

    Returns:
        0.0 where all points share one place, or there are fewer than two.

    >>> grid = np.stack(np.meshgrid(np.arange(30.0), np.arange(30.0), [0.0]), axis=-1).reshape(-1, 3)
    >>> round(scan_spacing(grid), 1)
    1.0
    """
    k = min(neighbors, len(xyz) - 1)
    if k < 1:
        return 0.0
    points = np.ascontiguousarray(xyz, dtype=np.float64)
    tree = Octree(points) if octree is None else octree
    farthest = tree.knn(points[_spread_rows(points)], k + 1).sq_dists[:, -1]
    return float(np.median(np.sqrt(farthest)) * np.sqrt(np.pi / k))


def _spread_rows(points: Float[np.ndarray, 'points 3']) -> Int[np.ndarray, ' rows']:
    """All points, or every so many-th from left to right: the order in which they come does not matter."""
    if len(points) <= SAMPLE:
        return np.arange(len(points))
    order = np.lexsort(points.T[::-1])
    return order[np.linspace(0, len(points) - 1, SAMPLE).astype(np.int64)]
