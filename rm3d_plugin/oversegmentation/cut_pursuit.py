"""Superpoints by l0 cut pursuit (Landrieu and Obozinski 2017; Superpoint-Graph, METHOD 3)."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple, final

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.oversegmentation.base import Oversegmenter
from rm3d_plugin.oversegmentation.small_regions import Affinity, absorb_small, unit_descriptors
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud

ALIKE = Affinity(normal_weight=0.0, descriptor_weight=1.0)  # small regions join by their descriptors alone


class NeighborGraph(NamedTuple):
    """Points joined to their nearest ones.

    Attributes:
        neighbors: (N, k) point numbers, -1 where there is none.
        edges: (E, 2) pairs i < j, each once, sorted.
        weights: (E,) 1 / (1 + d / mean d), in (0, 1].
    """

    neighbors: Int[np.ndarray, 'points k']
    edges: Int[np.ndarray, 'edges 2']
    weights: Float[np.ndarray, ' edges']


def neighbor_graph(xyz: Float[np.ndarray, 'points 3'], neighbors: int) -> NeighborGraph:
    """Join each point to its nearest ones; edges between near points weigh more."""
    count = len(xyz)
    near = Octree(xyz).knn(xyz, neighbors + 1).indices.astype(np.int64)
    itself = near == np.arange(count)[:, None]
    near[itself] = -1
    near[~itself.any(axis=1), -1] = -1  # as many copies of the point came before it: the last is one too many
    rows, slots = np.nonzero(near >= 0)
    ends = near[rows, slots]
    keys = np.unique(np.minimum(rows, ends) * count + np.maximum(rows, ends))
    edges = np.stack([keys // max(count, 1), keys % max(count, 1)], axis=1)
    lengths = np.linalg.norm(xyz[edges[:, 0]].astype(np.float64) - xyz[edges[:, 1]], axis=1)
    mean = lengths.mean() if len(lengths) else 0.0
    return NeighborGraph(near, edges, 1.0 / (1.0 + lengths / (mean if mean > 0 else 1.0)))


def cut_pursuit(
    features: Float[np.ndarray, 'points features'],
    edges: Int[np.ndarray, 'edges 2'],
    weights: Float[np.ndarray, ' edges'],
) -> Int[np.ndarray, ' points']:
    """Connected parts on which the minimiser x of sum |x - f|^2 + sum w [x_i != x_j] is constant (approximately).

    Args:
        features: (N, F) f, one row a point.
        edges: (E, 2) pairs of points, each once.
        weights: (E,) w, not negative (larger: fewer parts).

    Returns:
        Part of each point.

    Raises:
        ImportError: The solver is not installed.
        ValueError: A feature or weight is not finite.
    """
    if not (np.isfinite(features).all() and np.isfinite(weights).all()):
        raise ValueError('cut_pursuit: a feature or weight is NaN or infinite')
    if len(features) == 0:
        return np.zeros(0, dtype=np.int64)
    values = np.ascontiguousarray(features, dtype=np.float32)
    scaled = np.ascontiguousarray(weights, dtype=np.float32)
    first, second = np.ascontiguousarray(edges.T, dtype=np.uint32)
    strength = 1.0  # the package does nothing with it: only the edge weights count
    found = load_solver()(strength, values.shape[1], values, scaled, first, second, False)
    return _connected_parts(np.asarray(found).reshape(-1).astype(np.int64), edges)


def load_solver() -> Callable[..., np.ndarray]:
    """The solver of the optional package.

    Raises:
        ImportError: It is not installed; the message tells how to get it.
    """
    try:
        package = import_module('cut_pursuit_py')
    except ImportError as error:
        raise ImportError(
            'CutPursuit needs a solver that is not installed: pip install cut-pursuit-py '
            '(or choose another over-segmenter: RegionGrowing, VCCS)'
        ) from error
    solver: Callable[..., np.ndarray] = package.perform_cut_pursuit
    return solver


def _connected_parts(
    labels: Int[np.ndarray, ' points'], edges: Int[np.ndarray, 'edges 2']
) -> Int[np.ndarray, ' points']:
    """Divide each label into its connected parts: the solver leaves apart pieces that it never cut under one label."""
    inner = edges[labels[edges[:, 0]] == labels[edges[:, 1]]]
    graph = coo_array((np.ones(len(inner)), (inner[:, 0], inner[:, 1])), shape=(len(labels), len(labels)))
    return connected_components(graph, directed=False)[1].astype(np.int64)


@OVERSEGMENTERS.register_module()
@final
class CutPursuit(Oversegmenter):
    """Regions on which descriptors are nearly constant, as Superpoint-Graph makes them of ``SuperpointGraph`` features.

    Needs the package cut-pursuit-py. Labelled points play no part.

    Args:
        regularization: rho, the price of an edge between regions (larger: fewer, coarser regions). 0.03 to 0.1 indoors,
            0.8 for terrestrial laser scans outdoors.
        neighbors: Nearest points that each point is joined to.
        xyz_weight: Append the coordinates in metres times this to the descriptors (0.2 for learned embeddings).
        min_region: Regions of fewer points are absorbed by the neighbour with the most similar descriptors; 1 keeps
            all.
        ground: Options of :func:`rm3d_plugin.ops.ground.segment_ground`: removes the ground first. None keeps it.

    Raises:
        ValueError: A number is out of range.
    """

    def __init__(
        self,
        regularization: float = 0.03,
        neighbors: int = 10,
        xyz_weight: float = 0.0,
        min_region: int = 20,
        ground: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(ground)
        if not regularization > 0 or neighbors < 1 or not xyz_weight >= 0:
            raise ValueError(
                'CutPursuit: expected regularization > 0, neighbors >= 1, xyz_weight >= 0, '
                f'got {regularization}, {neighbors}, {xyz_weight}'
            )
        self.regularization = regularization
        self.neighbors = neighbors
        self.xyz_weight = xyz_weight
        self.min_region = min_region

    def partition(
        self,
        cloud: PointCloud,
        descriptors: Descriptors,
        seeds: Int[np.ndarray, ' seeds'] | None = None,
        scene: str = '',
    ) -> Int[np.ndarray, ' points']:
        """Cut, then absorb small regions."""
        features = np.where(descriptors.valid[:, None], descriptors.values, np.float32(0))
        if self.xyz_weight > 0:
            features = np.concatenate([features, self.xyz_weight * cloud.xyz], axis=1)
        graph = neighbor_graph(cloud.xyz, self.neighbors)
        labels = cut_pursuit(features, graph.edges, self.regularization * graph.weights)
        described = unit_descriptors(descriptors)
        return absorb_small(labels, graph.neighbors, np.zeros_like(cloud.xyz), described, self.min_region, ALIKE)
