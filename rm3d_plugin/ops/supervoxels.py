"""Supervoxels: voxels that grow around seeds, one ring at a time (VCCS, Papon et al., CVPR 2013; METHOD 3)."""

from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.ops.segment import segment_mean, segment_mean_axis
from rm3d_plugin.ops.voxel_grid import VoxelGrid, voxel_grid, voxel_neighbors

RINGS = 1.8  # growth reaches so many seed distances; METHOD 3
# Where the least coordinates lie within a cell, one share an axis: points on a plane or a lattice that starts there, as
# floors and thinned clouds do, stay clear of the cells' sides, so that rounding moves none of them into another cell.
CORNER = np.array([0.8192, 0.6710, 0.5497])  # Roberts 2018: powers of 1 / 1.2207, the least like any fractions
TIE = 1e-3  # distances that differ by a smaller share are equal: a moved cloud's float32 is rounded otherwise
SURFACE = 0.05  # a seed's surroundings hold at least this share of a plane through them; METHOD 3

DistanceKind = Literal['papon', 'pcl']


class VoxelFeatures(NamedTuple):
    """What voxels (or supervoxels) are compared by; an array of no columns takes its term out of the distance.

    Attributes:
        xyz: (V, 3) metres, mean of the points.
        colors: (V, 3) Lab for the distance of the paper, RGB in [0, 1] for PCL's; or (V, 0).
        normals: (V, 3) unit, of either sign; or (V, 0).
        histograms: (V, F) rows that sum to 1, or to 0 where not described; or (V, 0).
    """

    xyz: Float[np.ndarray, 'voxels 3']
    colors: Float[np.ndarray, 'voxels channels']
    normals: Float[np.ndarray, 'voxels axes']
    histograms: Float[np.ndarray, 'voxels bins']


class VoxelDistance(NamedTuple):
    """How far a voxel is from a supervoxel's centre.

    ``'papon'``: sqrt(color (dLab / color_scale)^2 + spatial dxyz^2 / (3 R_seed^2) + shape (1 - sum min(h, h'))^2).
    ``'pcl'``: color |dRGB| + spatial |dxyz| / R_seed + shape (1 - |n.n'|).

    Attributes:
        kind: Which of the two.
        color: Weight of colour (larger: supervoxels follow colour edges).
        spatial: Weight of distance (larger: rounder supervoxels).
        shape: Weight of histograms or normals (larger: supervoxels follow surfaces).
        color_scale: Lab units that count as 1 in the first.
    """

    kind: DistanceKind = 'papon'
    color: float = 0.1
    spatial: float = 0.4
    shape: float = 1.0
    color_scale: float = 15.0

    def check(self) -> None:
        """Raise ``ValueError`` where a number or the kind cannot be used."""
        if self.kind not in get_args(DistanceKind):
            raise ValueError(f'VoxelDistance.kind: expected one of {get_args(DistanceKind)}, got {self.kind!r}')
        if min(self.color, self.spatial, self.shape) < 0 or not self.color_scale > 0:
            raise ValueError(f'VoxelDistance: expected weights >= 0 and color_scale > 0, got {tuple(self[1:])}')


class Supervoxels(NamedTuple):
    """A partition into supervoxels.

    Attributes:
        labels: (N,) supervoxel of each point; -1 where none arrived.
        grid: The voxels.
        owner: (V,) supervoxel of each voxel; -1 where none arrived.
        seeds: How many seeds growth started from; labels from here on are groups that none of them reached.
    """

    labels: Int[np.ndarray, ' points']
    grid: VoxelGrid
    owner: Int[np.ndarray, ' voxels']
    seeds: int


def supervoxels(
    xyz: Float[np.ndarray, 'points 3'],
    colors: Float[np.ndarray, 'points 3'] | None,
    normals: Float[np.ndarray, 'points 3'] | None,
    histograms: Float[np.ndarray, 'points bins'] | None,
    voxel_size: float,
    seed_size: float,
    distance: VoxelDistance,
    discard_unreached: bool = False,
) -> Supervoxels:
    """VCCS: voxels, seeds, and int(1.8 R_seed / R_voxel) rings of growth (METHOD 3).

    Both grids start at the cloud's least coordinates, so that a moved cloud has the same supervoxels, as long as the
    rounding of its float32 coordinates takes no point over the side of a voxel.

    Args:
        xyz: (N, 3) metres.
        colors: Lab for the distance of the paper, RGB in [0, 1] for PCL's; None leaves the term out.
        normals: Unit, zero where unknown; PCL's distance uses them. None leaves the term out.
        histograms: Not negative, zero where not described; the paper's distance uses them. None leaves the term out.
        voxel_size: R_voxel, metres (not below the distance between points, or nothing connects).
        seed_size: R_seed, metres (larger: fewer, larger supervoxels).
        distance: What is near.
        discard_unreached: Leave -1 on voxels that no supervoxel reached, as the paper does with noise. Otherwise each
            connected group of them becomes a supervoxel.

    Raises:
        ValueError: A number is out of range, or a histogram is negative.
    """
    distance.check()
    if not seed_size > voxel_size > 0:
        raise ValueError(f'supervoxels: expected seed_size > voxel_size > 0 (metres), got {seed_size}, {voxel_size}')
    if histograms is not None and histograms.size and histograms.min() < 0:
        raise ValueError(
            'supervoxels: histogram intersection needs descriptors >= 0 (FPFH, PFH, ...), got '
            f'{histograms.min()}; take another descriptor, or the distance of kind "pcl"'
        )
    local = from_corner(xyz)
    grid = voxel_grid(local + CORNER * voxel_size, voxel_size)
    neighbors = voxel_neighbors(grid.coords)
    features = _voxel_features(local, colors, normals, histograms, grid)
    seeds = seed_voxels(features.xyz + CORNER * seed_size, seed_size, voxel_size)
    owner = grow_supervoxels(features, neighbors, seeds, seed_size, int(RINGS * seed_size / voxel_size), distance)
    if not discard_unreached:
        owner = label_unreached(owner, neighbors, len(seeds))
    return Supervoxels(owner[grid.point_to_voxel], grid, owner, len(seeds))


def from_corner(xyz: Float[np.ndarray, 'points 3']) -> Float[np.ndarray, 'points 3']:
    """Coordinates from the least ones of the cloud, metres, float64."""
    wide = xyz.astype(np.float64)
    return wide - wide.min(axis=0) if len(wide) else wide


def _voxel_features(
    xyz: Float[np.ndarray, 'points 3'],
    colors: Float[np.ndarray, 'points 3'] | None,
    normals: Float[np.ndarray, 'points 3'] | None,
    histograms: Float[np.ndarray, 'points bins'] | None,
    grid: VoxelGrid,
) -> VoxelFeatures:
    """Means over the points of each voxel."""
    voxel, count = grid.point_to_voxel, len(grid.coords)
    absent = np.zeros((count, 0))
    return VoxelFeatures(
        xyz=segment_mean(xyz, voxel, count),
        colors=absent if colors is None else segment_mean(colors, voxel, count),
        normals=absent if normals is None else segment_mean_axis(normals, voxel, count),
        histograms=absent if histograms is None else unit_sums(segment_mean(histograms, voxel, count)),
    )


def seed_voxels(xyz: Float[np.ndarray, 'voxels 3'], seed_size: float, voxel_size: float) -> Int[np.ndarray, ' seeds']:
    """One voxel for each occupied cell of a coarse grid: the nearest to the cell's centre (ties: the lowest number).

    A seed with fewer than 0.05 pi (R_seed / 2)^2 / R_voxel^2 voxels within R_seed / 2, itself included, is rejected.

    Args:
        xyz: Mean point of each voxel, metres.
        seed_size: R_seed, metres between seeds.
        voxel_size: R_voxel, metres.

    Returns:
        Numbers of voxels, ascending.
    """
    if len(xyz) == 0:
        return np.zeros(0, dtype=np.int64)
    cells = np.unique(np.floor(xyz.astype(np.float64) / seed_size), axis=0)
    tree = Octree(xyz)
    found = np.unique(tree.knn((cells + 0.5) * seed_size, 1).indices[:, 0]).astype(np.int64)
    counts = tree.radius(xyz[found], seed_size / 2, ordered=False).counts
    return found[counts >= SURFACE * np.pi * (seed_size / 2) ** 2 / voxel_size**2]


def grow_supervoxels(
    features: VoxelFeatures,
    neighbors: Int[np.ndarray, 'voxels 26'],
    seeds: Int[np.ndarray, ' seeds'],
    seed_size: float,
    rings: int,
    distance: VoxelDistance,
) -> Int[np.ndarray, ' voxels']:
    """Let all supervoxels grow at once, one ring at a time.

    In each ring every voxel looks at the supervoxels that it and its neighbours belong to and joins the one whose
    centre is nearest (ties, to a thousandth: it stays, then the lowest number); then centres become the means of their
    voxels. All voxels decide on the state before the ring, so the order in which they are visited does not matter.

    Args:
        features: One row a voxel.
        neighbors: Their neighbours, -1 = none.
        seeds: Voxels that supervoxels start from, different from each other.
        seed_size: R_seed, metres.
        rings: How often to grow.
        distance: What is near.

    Returns:
        Supervoxel of each voxel (position of its seed in ``seeds``); -1 where none arrived.
    """
    distance.check()
    owner = np.full(len(features.xyz), -1, dtype=np.int64)
    owner[seeds] = np.arange(len(seeds))
    if len(seeds) == 0:
        return owner
    given = VoxelFeatures(*(np.ascontiguousarray(part, dtype=np.float64) for part in features))
    centres = VoxelFeatures(*(part[seeds] for part in given))
    spatial = distance.spatial / (3 * seed_size**2 if distance.kind == 'papon' else seed_size)
    color = distance.color / (distance.color_scale**2 if distance.kind == 'papon' else 1.0)
    weights = (color, spatial, float(distance.shape))
    for _ in range(rings):
        owner, changed = _ring(owner, neighbors, given, centres, weights, distance.kind == 'papon')
        if not changed:
            break
        centres = _centres(given, owner, len(seeds))
    return owner


def _centres(features: VoxelFeatures, owner: Int[np.ndarray, ' voxels'], count: int) -> VoxelFeatures:
    """Means of the voxels of each supervoxel; one that lost all its voxels can win none back."""
    normals = features.normals
    return VoxelFeatures(
        xyz=segment_mean(features.xyz, owner, count),
        colors=segment_mean(features.colors, owner, count),
        normals=segment_mean_axis(normals, owner, count) if normals.shape[1] else np.zeros((count, 0)),
        histograms=unit_sums(segment_mean(features.histograms, owner, count)),
    )


def unit_sums(rows: Float[np.ndarray, 'rows bins']) -> Float[np.ndarray, 'rows bins']:
    """Rows divided by their sums; rows of zeros stay."""
    sums = rows.sum(axis=1, keepdims=True)
    return rows / np.where(sums > 0, sums, 1.0)


def label_unreached(
    owner: Int[np.ndarray, ' voxels'], neighbors: Int[np.ndarray, 'voxels 26'], count: int
) -> Int[np.ndarray, ' voxels']:
    """Number the connected groups of voxels without a supervoxel from ``count`` upwards."""
    rows, slots = np.nonzero((neighbors >= 0) & (owner < 0)[:, None])
    near = neighbors[rows, slots]
    both = owner[near] < 0
    graph = coo_array((np.ones(int(both.sum())), (rows[both], near[both])), shape=(len(owner), len(owner)))
    group = connected_components(graph, directed=False)[1].astype(np.int64)
    return np.where(owner < 0, count + group, owner)


@njit(cache=True, nogil=True)
def _ring(
    owner: np.ndarray,
    neighbors: np.ndarray,
    features: VoxelFeatures,
    centres: VoxelFeatures,
    weights: tuple[float, float, float],
    papon: bool,
) -> tuple[np.ndarray, bool]:
    out = owner.copy()
    changed = False
    near, far = np.empty(neighbors.shape[1] + 1, dtype=np.int64), np.empty(neighbors.shape[1] + 1)
    for voxel in range(len(owner)):
        count = _supervoxels_around(voxel, owner, neighbors, near)
        if count == 0 or (count == 1 and near[0] == owner[voxel]):
            continue
        for option in range(count):
            far[option] = _distance(voxel, near[option], features, centres, weights, papon)
        limit = far[:count].min() * (1 + TIE)
        if near[0] == owner[voxel] and far[0] <= limit:
            continue
        out[voxel] = near[:count][far[:count] <= limit].min()
        changed = True
    return out, changed


@njit(cache=True, nogil=True)
def _supervoxels_around(voxel: int, owner: np.ndarray, neighbors: np.ndarray, found: np.ndarray) -> int:
    """Fill ``found`` with the supervoxel of a voxel, where it has one, and the others beside it; how many they are."""
    count = 0
    if owner[voxel] >= 0:
        found[0] = owner[voxel]
        count = 1
    for other in neighbors[voxel]:
        if other >= 0 and owner[other] >= 0 and not np.any(found[:count] == owner[other]):
            found[count] = owner[other]
            count += 1
    return count


@njit(cache=True, nogil=True)
def _distance(
    voxel: int,
    centre: int,
    features: VoxelFeatures,
    centres: VoxelFeatures,
    weights: tuple[float, float, float],
    papon: bool,
) -> float:
    """Distance of a voxel to a centre; squared for the paper's, which orders them alike."""
    color, space, shape = 0.0, 0.0, 0.0
    for c in range(3):
        space += (features.xyz[voxel, c] - centres.xyz[centre, c]) ** 2
    for c in range(features.colors.shape[1]):
        color += (features.colors[voxel, c] - centres.colors[centre, c]) ** 2
    if papon:
        common, own = 0.0, 0.0
        for c in range(features.histograms.shape[1]):
            common += min(features.histograms[voxel, c], centres.histograms[centre, c])
            own += features.histograms[voxel, c]
        if own > 0:  # a voxel without histogram is compared by the rest alone
            shape = (1.0 - common) ** 2
    else:
        dot, known = 0.0, False
        for c in range(features.normals.shape[1]):
            dot += features.normals[voxel, c] * centres.normals[centre, c]
            known = known or features.normals[voxel, c] != 0.0
        if known:
            shape = max(1.0 - abs(dot), 0.0)  # rounding must not make a distance negative
        space, color = np.sqrt(space), np.sqrt(color)
    return weights[0] * color + weights[1] * space + weights[2] * shape
