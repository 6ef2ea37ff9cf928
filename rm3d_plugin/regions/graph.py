"""Which regions are neighbours, and the graph with their features (METHOD 6)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit, types
from numba.typed import Dict

from rm3d_plugin.ops.shared_octree import nearest_of_each
from rm3d_plugin.ops.voxel_grid import close_gaps
from rm3d_plugin.regions.features import region_features
from rm3d_plugin.structures import Descriptors, PointCloud, RegionGraph, Regions

TOUCH_NEIGHBORS = 16  # where no gap is given, regions touch if a point has one of the other among so many nearest
CHUNK = 1 << 16  # points whose nearest ones are held at a time
MOST_CELLS = 2**20 - 2  # along an axis; beyond that empty stretches are cut short


class RegionGaps(NamedTuple):
    """Pairs of regions and how near they come to each other.

    Attributes:
        pairs: (P, 2) int64 region numbers i < j, sorted.
        gaps: (P,) float64 smallest distance between a point of one and a point of the other, in metres.
    """

    pairs: Int[np.ndarray, 'pairs 2']
    gaps: Float[np.ndarray, ' pairs']


def build_region_graph(
    cloud: PointCloud, descriptors: Descriptors, regions: Regions, neighbors: int = 8, max_gap: float | None = None
) -> RegionGraph:
    """Features of all regions and the edges between adjacent ones.

    Args:
        cloud: With normals and curvature.
        descriptors: One row a point.
        regions: The partition; points of label -1 count nowhere.
        neighbors: Each region keeps this many adjacent regions, those of the smallest gap (ties: lower number); an edge
            stays if either end keeps it.
        max_gap: Regions are adjacent if they come this near, in metres. None: if a point of one has a point of the
            other among its 16 nearest.

    Raises:
        SceneError: Normals or curvature are missing.
        ValueError: Numbers of points differ, or a parameter is out of range.
    """
    if neighbors < 1 or (max_gap is not None and max_gap <= 0):
        raise ValueError(
            f'build_region_graph: expected neighbors >= 1 and max_gap > 0 or None, got {neighbors}, {max_gap}'
        )
    features = region_features(cloud, descriptors, regions)
    near = touching_regions(cloud.xyz, regions) if max_gap is None else regions_within(cloud.xyz, regions, max_gap)
    edges = keep_nearest(near, len(regions), neighbors)
    return RegionGraph(**features._asdict(), sizes=regions.sizes, edges=edges)


def touching_regions(xyz: Float[np.ndarray, 'points 3'], regions: Regions, k: int = TOUCH_NEIGHBORS) -> RegionGaps:
    """Pairs of regions where a point of one has a point of the other among its k nearest (itself included)."""
    members = np.sort(regions.indices)
    points, labels = (xyz, regions.labels) if len(members) == len(xyz) else (xyz[members], regions.labels[members])
    best = Dict.empty(key_type=types.int64, value_type=types.float64)
    for rows, near in nearest_of_each(points, k, CHUNK):
        _note_touching(labels, rows, near.indices, near.sq_dists, len(regions), best)
    return _gaps_of(best, len(regions))


def _gaps_of(best: 'Dict[int, float]', count: int) -> RegionGaps:
    """The noted squared gaps of pairs i * count + j, sorted by pair."""
    found, squared = _entries(best)
    order = np.argsort(found)
    found = found[order]
    return RegionGaps(np.stack([found // max(count, 1), found % max(count, 1)], axis=1), np.sqrt(squared[order]))


def regions_within(xyz: Float[np.ndarray, 'points 3'], regions: Regions, max_gap: float) -> RegionGaps:
    """All pairs of regions that come within ``max_gap`` metres of each other, with their gaps.

    Points are sorted into cells of that size; two groups (the points that one region owns in one cell) are compared
    only if their boxes are nearer than the best gap known for the two regions, so that the inside of a region is free.
    """
    members = np.sort(regions.indices)
    if not len(members):
        return RegionGaps(np.zeros((0, 2), dtype=np.int64), np.zeros(0))
    points, labels = xyz[members].astype(np.float64), regions.labels[members]
    # One empty cell all around spares the search for neighbours any test of the border.
    cells = close_gaps(np.floor((points - points.min(axis=0)) / max_gap).astype(np.int64) + 1, MOST_CELLS)
    span = cells.max(axis=0) + 2
    if np.prod(span.astype(np.float64)) > 2.0**62:
        raise ValueError(f'regions_within: {span} cells of {max_gap} m; drop far outliers or raise max_gap')
    keys = (cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2]
    order = np.lexsort((labels, keys))
    points, labels, keys = points[order], labels[order], keys[order]
    starts = np.flatnonzero(np.r_[True, (keys[1:] != keys[:-1]) | (labels[1:] != labels[:-1])])
    low, high = np.minimum.reduceat(points, starts, axis=0), np.maximum.reduceat(points, starts, axis=0)
    groups = _Groups(points, labels[starts], keys[starts], np.append(starts, len(points)), low, high)
    return _gaps_of(_nearest_between_groups(groups, _neighbor_shifts(span), len(regions), max_gap**2), len(regions))


def keep_nearest(near: RegionGaps, count: int, neighbors: int) -> Int[np.ndarray, 'edges 2']:
    """Edges that are among the ``neighbors`` of smallest gap of either end; sorted pairs i < j."""
    ends = np.concatenate([near.pairs, near.pairs[:, ::-1]])
    edge = np.tile(np.arange(len(near.pairs)), 2)
    order = np.lexsort((ends[:, 1], near.gaps[edge], ends[:, 0]))
    owner = ends[order, 0]
    first = np.searchsorted(owner, np.arange(count))
    rank = np.arange(len(owner)) - first[owner]
    kept = np.unique(edge[order][rank < neighbors])
    return near.pairs[kept].astype(np.int64)


def _neighbor_shifts(span: Int[np.ndarray, '3']) -> Int[np.ndarray, '27']:
    """Differences of the key of a cell and those around it."""
    steps = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing='ij'), axis=-1).reshape(-1, 3)
    return (steps[:, 0] * span[1] + steps[:, 1]) * span[2] + steps[:, 2]


class _Groups(NamedTuple):
    """Points of one region in one cell each, sorted by cell: G groups.

    Attributes:
        points: (P, 3) metres, group by group.
        labels: (G,) region.
        keys: (G,) cell.
        bounds: (G + 1,) where each begins among the points.
        low: (G, 3) lower corner of its box.
        high: (G, 3) upper corner.
    """

    points: np.ndarray
    labels: np.ndarray
    keys: np.ndarray
    bounds: np.ndarray
    low: np.ndarray
    high: np.ndarray


@njit(cache=True)
def _box_gap(groups: _Groups, g: int, h: int) -> float:
    """Squared distance of two boxes."""
    total = 0.0
    for c in range(3):
        d = max(groups.low[h, c] - groups.high[g, c], groups.low[g, c] - groups.high[h, c], 0.0)
        total += d * d
    return total


@njit(cache=True)
def _point_gap(groups: _Groups, g: int, h: int, best: float) -> float:
    """Least squared distance between the points of two groups, or ``best`` if none is nearer."""
    for p in range(groups.bounds[g], groups.bounds[g + 1]):
        for q in range(groups.bounds[h], groups.bounds[h + 1]):
            d = 0.0
            for c in range(3):
                d += (groups.points[p, c] - groups.points[q, c]) ** 2
            best = min(best, d)
    return best


@njit(cache=True)
def _nearest_between_groups(groups: _Groups, shifts: np.ndarray, count: int, limit: float) -> 'Dict[int, float]':
    """Best squared gap of each pair of regions (as i * count + j, i < j) that is within the limit."""
    best = Dict.empty(key_type=types.int64, value_type=types.float64)
    beyond = np.nextafter(limit, np.inf)
    labels, keys = groups.labels, groups.keys
    for g in range(len(keys)):
        for shift in shifts:
            h = np.searchsorted(keys, keys[g] + shift)
            while h < len(keys) and keys[h] == keys[g] + shift:
                if labels[h] > labels[g]:
                    pair = labels[g] * count + labels[h]
                    known = best.get(pair, beyond)
                    if _box_gap(groups, g, h) < known:
                        gap = _point_gap(groups, g, h, known)
                        if gap < known:
                            best[pair] = gap
                h += 1
    return best


@njit(cache=True)
def _note_touching(
    labels: np.ndarray,
    rows: np.ndarray,
    indices: np.ndarray,
    sq_dists: np.ndarray,
    count: int,
    best: 'Dict[int, float]',
) -> None:
    """Note the least squared distance of each pair of regions among some points and their nearest ones."""
    for at in range(len(rows)):
        own = labels[rows[at]]
        for slot in range(indices.shape[1]):
            if indices[at, slot] < 0 or labels[indices[at, slot]] == own:
                continue
            other = labels[indices[at, slot]]
            pair = min(own, other) * count + max(own, other)
            if sq_dists[at, slot] < best.get(pair, np.inf):
                best[pair] = sq_dists[at, slot]


@njit(cache=True)
def _entries(best: 'Dict[int, float]') -> tuple[np.ndarray, np.ndarray]:
    """Keys and values."""
    found, squared = np.empty(len(best), dtype=np.int64), np.empty(len(best))
    n = 0
    for pair, gap in best.items():
        found[n], squared[n] = pair, gap
        n += 1
    return found, squared
