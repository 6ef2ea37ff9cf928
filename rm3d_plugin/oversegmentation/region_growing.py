"""Region growing on points: Algorithm 1 with Conditions 1 and 2 (METHOD 5)."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, Self, final

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.normals import estimate_normals
from rm3d_plugin.ops.octree import Knn
from rm3d_plugin.ops.shared_octree import nearest_of_each
from rm3d_plugin.oversegmentation.base import Oversegmenter
from rm3d_plugin.oversegmentation.small_regions import (
    Affinity,
    UnitDescriptors,
    absorb_small,
    drop_small,
    unit_descriptors,
)
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud

PRESETS: dict[str, dict[str, Any]] = {
    # Rooms at 1 to 5 cm between points: at 0.02 some rooms leak from wall to wall around an edge, at 0.015 none did.
    'indoor': {'zeta': 0.015},
    # A spinning lidar on a street: objects stand apart, so curvature may vary more than indoors; the reach follows the
    # distance between scan lines. On 12 KITTI frames 90 % of an object (50 points or more) lie in 1.9 regions.
    'lidar': {
        'threshold': 0.9,
        'zeta': 0.05,
        'min_region': 30,
        'max_edge': 0.2,  # m
        'range_growth': 0.01,
        'ground': {},
    },
}
CHUNK = 1 << 14  # points whose neighbours are held with their distances
BLOCK = 1024  # points whose links one thread decides at a time


class Links(NamedTuple):
    """Neighbours of each point that are near enough, and whether growing may cross.

    Attributes:
        neighbors: (N, k) point numbers, -1 where there is none within reach.
        joins: (N, k) bool, Condition 1.
    """

    neighbors: Int[np.ndarray, 'points k']
    joins: np.ndarray


def link_points(
    xyz: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    descriptors: UnitDescriptors,
    neighbors: int,
    reach: Float[np.ndarray, ' points'],
    threshold: float,
    affinity: Affinity,
) -> Links:
    """Decide Condition 1 for each point and its nearest neighbours.

    Args:
        xyz: Metres.
        normals: Unit vectors of either sign; zero where unknown: the term drops out of the affinity and its normaliser.
        descriptors: Unit rows; zero where not valid: the term drops out likewise.
        neighbors: How many nearest points are looked at.
        reach: Metres; a neighbour farther away never joins.
        threshold: Least affinity to join.
        affinity: Its weights.
    """
    found = np.empty((len(xyz), neighbors + 1), dtype=np.int32)
    joins = np.empty(found.shape, dtype=np.bool_)
    known = (normals, normals.any(axis=1), descriptors)
    limits, condition = np.square(reach, dtype=np.float64), (float(threshold), *affinity)
    for rows, near in nearest_of_each(xyz, neighbors + 1, CHUNK):

        def work(start: int, stop: int, rows: np.ndarray = rows, near: Knn = near) -> None:
            _link_block(start, stop, rows, near.indices, near.sq_dists, limits, *known, *condition, found, joins)

        map_blocks(work, len(rows), BLOCK)
    return Links(found, joins)


def without_color_steps(links: Links, colors: Float[np.ndarray, 'points 3'], step: float) -> Links:
    """Links that do not cross an edge of colour.

    Args:
        links: As of :func:`link_points`.
        colors: RGB in [0, 1].
        step: Greatest RGB difference of two neighbours that join.
    """
    joins = links.joins.copy()
    for first in range(0, len(colors), CHUNK):
        rows = slice(first, first + CHUNK)
        difference = colors[np.maximum(links.neighbors[rows], 0)] - colors[rows, None]
        joins[rows] &= np.linalg.norm(difference, axis=2) <= step
    return Links(links.neighbors, joins)


def grow_regions(
    links: Links, order: Int[np.ndarray, ' points'], curvature: Float[np.ndarray, ' points'], zeta: float
) -> Int[np.ndarray, ' points']:
    """Algorithm 1 on points.

    Args:
        links: Neighbours and Condition 1.
        order: All points, in the order in which they become seeds if no region has reached them by then.
        curvature: Curvature of each point.
        zeta: Condition 2: a point that joined goes on growing where its curvature differs by at most this.

    Returns:
        Region of each point, numbered in the order of the seeds.
    """
    return _grow(links.neighbors, links.joins, order, np.asarray(curvature, dtype=np.float64), zeta)


def seed_order(
    curvature: Float[np.ndarray, ' points'], seeds: Int[np.ndarray, ' seeds'] | None
) -> Int[np.ndarray, ' points']:
    """Labelled points first, then all by curvature, each group ascending, ties by number.

    The lowest 2 permille of curvature that Algorithm 1 starts from are the head of the second group: as each seed grows
    until it stops before the next one starts, they need no group of their own.
    """
    order = np.argsort(curvature, kind='stable')
    if seeds is None:
        return order
    first = np.zeros(len(curvature), dtype=np.bool_)
    first[seeds] = True
    return np.concatenate([order[first[order]], order[~first[order]]])


@OVERSEGMENTERS.register_module()
@final
class RegionGrowing(Oversegmenter):
    """Regions of points that are alike in normal, descriptor and curvature (METHOD 5).

    Args:
        threshold: Condition 1: least affinity to join. Larger: smaller, purer regions.
        theta: The same in the paper's terms, an angle in degrees whose cosine replaces ``threshold``; None leaves it.
        zeta: Condition 2: curvature difference up to which a point that joined goes on growing. Larger: larger regions.
        neighbors: Nearest points that a seed looks at.
        min_region: Regions of fewer points are absorbed by their most affine neighbour.
        drop_below: Regions of fewer points are discarded (label -1; N_ths of the paper); None keeps all.
        affinity_normal_weight: Weight of the normals in the affinity.
        affinity_descriptor_weight: Weight of the descriptors.
        normalise_affinity: Divide the affinity by its weights; False is the paper's formula as printed.
        max_edge: Metres; a neighbour farther away never joins nor absorbs. None: no limit.
        range_growth: Metres that ``max_edge`` gains for each metre from the sensor; of no effect where the cloud does
            not know its sensor.
        max_color_step: RGB difference, of 1, above which two neighbours never join: regions end at the edge of a
            picture or a door that lies flush with its wall. Of no effect on clouds without colour. None: no limit.
        normal_neighbors: Neighbours for normals and curvature where the cloud has none.
        ground: Options of :func:`rm3d_plugin.ops.ground.segment_ground`: removes the ground first. None keeps it.
    """

    def __init__(
        self,
        threshold: float = 0.8,
        theta: float | None = None,
        zeta: float = 0.02,
        neighbors: int = 12,
        min_region: int = 20,
        drop_below: int | None = None,
        affinity_normal_weight: float = 1.0,
        affinity_descriptor_weight: float = 1.0,
        normalise_affinity: bool = True,
        max_edge: float | None = None,
        range_growth: float = 0.0,
        max_color_step: float | None = None,
        normal_neighbors: int = 20,
        ground: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(ground)
        if neighbors < 1 or zeta < 0 or (max_edge is not None and max_edge <= 0) or range_growth < 0:
            raise ValueError(
                f'RegionGrowing: expected neighbors >= 1, zeta >= 0, max_edge > 0 or None, range_growth >= 0, '
                f'got {neighbors}, {zeta}, {max_edge}, {range_growth}'
            )
        if max_color_step is not None and max_color_step <= 0:
            raise ValueError(f'RegionGrowing.max_color_step: expected a number > 0 or None, got {max_color_step}')
        if min(affinity_normal_weight, affinity_descriptor_weight) < 0:
            raise ValueError('RegionGrowing: affinity weights must not be negative')
        self.threshold = threshold if theta is None else float(np.cos(np.deg2rad(theta)))
        self.zeta = zeta
        self.neighbors = neighbors
        self.min_region = min_region
        self.drop_below = drop_below
        self.affinity = Affinity(float(affinity_normal_weight), float(affinity_descriptor_weight), normalise_affinity)
        self.max_edge = max_edge
        self.range_growth = range_growth
        self.max_color_step = max_color_step
        self.normal_neighbors = normal_neighbors

    @classmethod
    def preset(cls, name: Literal['indoor', 'lidar']) -> Self:
        """The over-segmenter with the numbers that suit a kind of scene, see ``PRESETS``."""
        if name not in PRESETS:
            raise ValueError(f'RegionGrowing.preset: expected one of {sorted(PRESETS)}, got {name!r}')
        return cls(**PRESETS[name])

    def partition(
        self,
        cloud: PointCloud,
        descriptors: Descriptors,
        seeds: Int[np.ndarray, ' seeds'] | None = None,
        scene: str = '',
    ) -> Int[np.ndarray, ' points']:
        """Grow, absorb, drop."""
        if len(cloud) == 0:
            return np.zeros(0, dtype=np.int64)
        normals, curvature = self._normals(cloud)
        described = unit_descriptors(descriptors)
        links = link_points(
            cloud.xyz, normals, described, self.neighbors, self._reach(cloud), self.threshold, self.affinity
        )
        if self.max_color_step is not None and cloud.colors is not None:
            links = without_color_steps(links, cloud.colors, self.max_color_step)
        labels = grow_regions(links, seed_order(curvature, seeds), curvature, self.zeta)
        labels = absorb_small(labels, links.neighbors, normals, described, self.min_region, self.affinity)
        return labels if self.drop_below is None else drop_small(labels, self.drop_below)

    def _normals(self, cloud: PointCloud) -> tuple[Float[np.ndarray, 'points 3'], Float[np.ndarray, ' points']]:
        if cloud.normals is not None and cloud.curvature is not None:
            return cloud.normals, cloud.curvature
        found = estimate_normals(cloud.xyz, k=self.normal_neighbors, viewpoint=cloud.sensor)
        normals = cloud.normals if cloud.normals is not None else np.where(found.valid[:, None], found.normals, 0.0)
        curvature = cloud.curvature if cloud.curvature is not None else found.curvature
        return normals.astype(np.float32), curvature.astype(np.float32)

    def _reach(self, cloud: PointCloud) -> Float[np.ndarray, ' points']:
        """How far each point looks, in metres."""
        if self.max_edge is None:
            return np.full(len(cloud), np.inf)
        if cloud.sensor is None:
            return np.full(len(cloud), float(self.max_edge))
        distance = np.linalg.norm(cloud.xyz - np.asarray(cloud.sensor), axis=1)
        return self.max_edge + self.range_growth * distance


@njit(cache=True, nogil=True)
def _link_block(
    start: int,
    stop: int,
    rows: np.ndarray,
    indices: np.ndarray,
    sq_dists: np.ndarray,
    limits: np.ndarray,
    normals: np.ndarray,
    known_normal: np.ndarray,
    descriptors: UnitDescriptors,
    threshold: float,
    normal_weight: float,
    descriptor_weight: float,
    normalised: bool,
    neighbors: np.ndarray,
    joins: np.ndarray,
) -> None:
    """Neighbours within reach of ``rows[start:stop]``, and Condition 1; compares squares, which spares the root."""
    source, row, scale = descriptors
    own = np.empty(source.shape[1], dtype=np.float32)
    for at in range(start, stop):
        i = rows[at]
        for c in range(len(own)):
            own[c] = source[row[i], c] * scale[i]
        for slot in range(indices.shape[1]):
            j = indices[at, slot]
            if j == i or j < 0 or sq_dists[at, slot] > limits[i]:
                neighbors[i, slot], joins[i, slot] = -1, False
                continue
            neighbors[i, slot] = j
            squared, total = 0.0, 0.0
            if known_normal[i] and known_normal[j]:
                dot = 0.0
                for c in range(3):
                    dot += normals[i, c] * normals[j, c]
                squared += normal_weight * dot * dot
                total += normal_weight
            if scale[i] > 0 and scale[j] > 0:
                total += descriptor_weight
                needed = threshold * threshold * (total if normalised else 1.0) - squared
                if needed > 0 and needed <= descriptor_weight:  # otherwise the normals have decided
                    dot = 0.0
                    for c in range(len(own)):
                        dot += own[c] * (source[row[j], c] * scale[j])
                    dot = min(max(dot, 0.0), 1.0)
                    squared += descriptor_weight * dot * dot
            joins[i, slot] = total > 0 and squared >= threshold * threshold * (total if normalised else 1.0)


@njit(cache=True)
def _grow(
    neighbors: np.ndarray, joins: np.ndarray, order: np.ndarray, curvature: np.ndarray, zeta: float
) -> np.ndarray:
    labels = np.full(len(order), -1, dtype=np.int64)
    queue = np.empty(len(order), dtype=np.int64)
    region = 0
    for start in order:
        if labels[start] >= 0:
            continue
        labels[start] = region
        queue[0] = start
        head, tail = 0, 1
        while head < tail:
            seed = queue[head]
            head += 1
            for slot in range(neighbors.shape[1]):
                j = neighbors[seed, slot]
                if j < 0 or not joins[seed, slot] or labels[j] >= 0:
                    continue
                labels[j] = region
                if abs(curvature[j] - curvature[seed]) <= zeta:
                    queue[tail] = j
                    tail += 1
        region += 1
    return labels
