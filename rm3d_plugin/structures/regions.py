"""A partition of a scene's points, and the graph of its regions."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int


def number_by_first_point(labels: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """Renumber labels 0..R-1 in the order of each region's first point; -1 stays -1."""
    labels = np.asarray(labels, dtype=np.int64)
    if _are_numbered(labels):
        return labels.copy()
    kept = labels >= 0
    _, first, inverse = np.unique(labels[kept], return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first, kind='stable')] = np.arange(len(first))
    out = np.full(len(labels), -1, dtype=np.int64)
    out[kept] = rank[inverse]
    return out


def _are_numbered(labels: Int[np.ndarray, ' points']) -> bool:
    """Whether each new label is one more than the greatest before it."""
    before = np.concatenate([[-1], np.maximum.accumulate(labels)[:-1]])
    return bool((labels >= -1).all() and (labels <= before + 1).all())


@dataclass(frozen=True, eq=False)
class Regions:
    """A label for every point, and the same as lists of points.

    Regions are numbered by their first point, so equal partitions have equal labels.

    Attributes:
        labels: (N,) int64; -1 = discarded, ignored by every module.
        offsets: (R + 1,) int64; points of region r are ``indices[offsets[r]:offsets[r + 1]]``.
        indices: (sum of sizes,) int64 point numbers, ascending within a region.
    """

    labels: Int[np.ndarray, ' points']
    offsets: Int[np.ndarray, ' regions_and_one'] = field(init=False)
    indices: Int[np.ndarray, ' kept'] = field(init=False)

    def __post_init__(self) -> None:
        given = np.asarray(self.labels)
        if given.ndim != 1 or not np.issubdtype(given.dtype, np.integer):
            raise ValueError(f'Regions.labels: expected integers of shape (N,), got {given.dtype} {given.shape}')
        if len(given) and given.min() < -1:
            raise ValueError(f'Regions.labels: expected labels >= -1, got {given.min()}')
        labels = number_by_first_point(given)
        order = np.argsort(labels, kind='stable')
        discarded = int((labels < 0).sum())
        sizes = np.bincount(labels[labels >= 0], minlength=0)
        object.__setattr__(self, 'labels', labels)
        object.__setattr__(self, 'indices', order[discarded:].astype(np.int64))
        object.__setattr__(self, 'offsets', np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64))

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def sizes(self) -> Int[np.ndarray, ' regions']:
        """Points of each region."""
        return np.diff(self.offsets)

    def points_of(self, region: int) -> Int[np.ndarray, ' members']:
        """Point numbers of one region, ascending."""
        return self.indices[self.offsets[region] : self.offsets[region + 1]]

    def pool_mean(self, values: Float[np.ndarray, 'points channels']) -> Float[np.ndarray, 'regions channels']:
        """Mean of per-point rows over each region; float64."""
        if len(values) != len(self.labels):
            raise ValueError(f'pool_mean: expected {len(self.labels)} rows, got {len(values)}')
        if len(self) == 0:
            return np.zeros((0, values.shape[1]))
        sums = np.add.reduceat(values[self.indices].astype(np.float64), self.offsets[:-1], axis=0)
        return sums / self.sizes[:, None]


@dataclass(frozen=True, eq=False)
class RegionGraph:
    """Regions with their features and their neighbours (METHOD 6).

    Attributes:
        centroids: (R, 3) float64 metres.
        normals: (R, 3) float64 sign-aligned unit mean normals.
        curvatures: (R,) float64 mean curvature.
        descriptors: (R, F) float64 mean descriptor; zero where no point of the region is valid.
        colors: (R, D) float64 mean Lab colour (D = 3) or intensity (D = 1), or None where the scan has neither.
        extents: (R, 3) float64 PCA extents in metres, longest first.
        sizes: (R,) int64 points.
        edges: (E, 2) int64 pairs i < j of adjacent regions, sorted.
    """

    centroids: Float[np.ndarray, 'regions 3']
    normals: Float[np.ndarray, 'regions 3']
    curvatures: Float[np.ndarray, ' regions']
    descriptors: Float[np.ndarray, 'regions features']
    colors: Float[np.ndarray, 'regions channels'] | None
    extents: Float[np.ndarray, 'regions 3']
    sizes: Int[np.ndarray, ' regions']
    edges: Int[np.ndarray, 'edges 2']

    def __post_init__(self) -> None:
        n = len(self.sizes)
        for name in ('centroids', 'normals', 'curvatures', 'descriptors', 'extents'):
            rows = len(getattr(self, name))
            if rows != n:
                raise ValueError(f'RegionGraph.{name}: expected {n} rows (one a region), got {rows}')
        if len(self.edges) and not (self.edges[:, 0] < self.edges[:, 1]).all():
            raise ValueError('RegionGraph.edges: expected pairs i < j')
        if len(self.edges) and (self.edges.min() < 0 or self.edges.max() >= n):
            raise ValueError(f'RegionGraph.edges: expected region numbers below {n}, got {self.edges.max()}')

    def __len__(self) -> int:
        return len(self.sizes)
