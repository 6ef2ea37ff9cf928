"""How alike points or regions are, and what becomes of regions that are too small (METHOD 5)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.ops.segment import segment_mean_axis, segment_sizes, segment_sum
from rm3d_plugin.structures import Descriptors

BLOCK = 1 << 14  # points whose lengths one thread computes at a time


class Affinity(NamedTuple):
    """How alike two points or regions are: A = sqrt(ln An^2 + ld Ad^2), paper 3.4.

    Attributes:
        normal_weight: Weight ln of the normals' |cosine|.
        descriptor_weight: Weight ld of the descriptors' cosine, clipped to [0, 1].
        normalised: Divide by sqrt(ln + ld), so that A is in [0, 1]; False is the paper's formula as printed.
    """

    normal_weight: float = 1.0
    descriptor_weight: float = 1.0
    normalised: bool = True


class UnitDescriptors(NamedTuple):
    """Descriptors of length one, so that a dot product is a cosine; scaled when they are met, which spares a copy.

    Attributes:
        source: (M, F) float32 rows of any length.
        rows: (N,) row of each point.
        scale: (N,) float32 what makes its length one; 0 where it is not valid or of no length.
    """

    source: Float[np.ndarray, 'rows features']
    rows: Int[np.ndarray, ' points']
    scale: Float[np.ndarray, ' points']

    def sums(self, labels: Int[np.ndarray, ' points'], count: int) -> Float[np.ndarray, 'regions features']:
        """Sum of the unit rows of each region, float64."""
        out = np.zeros((count, self.source.shape[1]))
        _add_unit_rows(*self, labels, out)
        return out


def unit_descriptors(descriptors: Descriptors) -> UnitDescriptors:
    """Unit rows of descriptors; zero where not valid or of no length."""
    rows, scale = descriptors.row_numbers(), np.zeros(len(descriptors), dtype=np.float32)
    map_blocks(
        lambda start, stop: _scales(descriptors.source, rows, descriptors.valid, start, stop, scale), len(rows), BLOCK
    )
    return UnitDescriptors(descriptors.source, rows, scale)


def unit_rows(values: np.ndarray, valid: np.ndarray) -> Float[np.ndarray, 'rows channels']:
    """Rows of length one, so that a dot product is a cosine; zero where not valid or of no length."""
    length = np.sqrt(np.einsum('ij,ij->i', values, values, dtype=np.float64))
    scale = np.where(valid & (length > 0), 1.0 / np.where(length > 0, length, 1.0), 0.0)
    return np.ascontiguousarray(values * scale[:, None].astype(values.dtype))


def pair_affinity(
    normals: Float[np.ndarray, 'rows 3'],
    descriptors: Float[np.ndarray, 'rows features'],
    pairs: Int[np.ndarray, 'pairs 2'],
    affinity: Affinity,
) -> Float[np.ndarray, ' pairs']:
    """Affinity of pairs of rows; zero rows drop out as in :func:`link_points`."""
    rows, partners = pairs[:, 0], pairs[:, 1]
    a_normal = np.abs(np.einsum('ij,ij->i', normals[rows], normals[partners]))
    a_descriptor = np.clip(np.einsum('ij,ij->i', descriptors[rows], descriptors[partners]), 0.0, 1.0)
    known_normal, known_descriptor = (normals != 0).any(axis=1), (descriptors != 0).any(axis=1)
    w_normal = affinity.normal_weight * (known_normal[rows] & known_normal[partners])
    w_descriptor = affinity.descriptor_weight * (known_descriptor[rows] & known_descriptor[partners])
    total = w_normal + w_descriptor
    squared = w_normal * np.square(a_normal) + w_descriptor * np.square(a_descriptor)
    if affinity.normalised:
        squared = np.divide(squared, total, out=np.zeros_like(squared), where=total > 0)
    return np.sqrt(squared)


def absorb_small(
    labels: Int[np.ndarray, ' points'],
    neighbors: Int[np.ndarray, 'points k'],
    normals: Float[np.ndarray, 'points 3'],
    descriptors: UnitDescriptors,
    min_region: int,
    affinity: Affinity,
) -> Int[np.ndarray, ' points']:
    """Join each region of fewer than ``min_region`` points to its most affine adjacent region.

    All small regions choose at once, ties to the region of the lower number, and the round repeats until every small
    region has grown or has no neighbour. A region that is large enough chooses nobody, so no two such are joined.
    """
    if not len(labels):
        return labels
    pairs = _adjacent_regions(labels, neighbors)
    sums = descriptors.sums(labels, int(labels.max()) + 1)
    while True:
        count = len(sums)
        small = segment_sizes(labels, count) < min_region
        asking = pairs[small[pairs[:, 0]]]
        if not len(asking):
            return labels
        axes = segment_mean_axis(normals, labels, count)
        score = pair_affinity(axes, unit_rows(sums, np.ones(count, dtype=np.bool_)), asking, affinity)
        order = np.lexsort((asking[:, 1], -score, asking[:, 0]))
        chooser, first = np.unique(asking[order, 0], return_index=True)
        edges = coo_array((np.ones(len(chooser)), (chooser, asking[order[first], 1])), shape=(count, count))
        group = connected_components(edges, directed=False)[1].astype(np.int64)
        labels, sums = group[labels], segment_sum(sums, group, int(group.max()) + 1)
        pairs = _unique_pairs(group[pairs[:, 0]], group[pairs[:, 1]])


def drop_small(labels: Int[np.ndarray, ' points'], least: int) -> Int[np.ndarray, ' points']:
    """Discard (-1) the regions of fewer than ``least`` points."""
    sizes = segment_sizes(labels, int(labels.max()) + 1 if len(labels) else 0)
    small = np.append(sizes < least, True)  # the last entry answers for label -1
    return np.where(small[labels], -1, labels)


@njit(cache=True, nogil=True)
def _scales(source: np.ndarray, rows: np.ndarray, valid: np.ndarray, start: int, stop: int, scale: np.ndarray) -> None:
    """What makes the rows of points ``start`` to ``stop`` as long as one."""
    for i in range(start, stop):
        total = 0.0
        for c in range(source.shape[1]):
            total += np.float64(source[rows[i], c]) * source[rows[i], c]
        if valid[i] and total > 0:
            scale[i] = 1.0 / np.sqrt(total)


@njit(cache=True, nogil=True)
def _add_unit_rows(
    source: np.ndarray, rows: np.ndarray, scale: np.ndarray, labels: np.ndarray, out: np.ndarray
) -> None:
    for i in range(len(labels)):
        if labels[i] >= 0:
            for c in range(source.shape[1]):
                out[labels[i], c] += source[rows[i], c] * scale[i]


def _adjacent_regions(
    labels: Int[np.ndarray, ' points'], neighbors: Int[np.ndarray, 'points k']
) -> Int[np.ndarray, 'pairs 2']:
    """Pairs of regions that own neighbouring points, in both orders, sorted."""
    a, b = _crossing_links(labels, neighbors)
    return _unique_pairs(np.concatenate([a, b]), np.concatenate([b, a]))


@njit(cache=True, nogil=True)
def _crossing_links(labels: np.ndarray, neighbors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels of both ends of each link between two regions; without repeats in a row."""
    count, capacity = 0, 1024
    a, b = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    for i in range(len(labels)):
        if count + neighbors.shape[1] > capacity:
            capacity = 2 * (count + neighbors.shape[1])
            more_a, more_b = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
            more_a[:count], more_b[:count] = a[:count], b[:count]
            a, b = more_a, more_b
        last = labels[i]
        for slot in range(neighbors.shape[1]):
            j = neighbors[i, slot]
            if j >= 0 and labels[j] != labels[i] and labels[j] != last:
                last = labels[j]
                a[count], b[count] = labels[i], last
                count += 1
    return a[:count], b[:count]


def _unique_pairs(a: Int[np.ndarray, ' pairs'], b: Int[np.ndarray, ' pairs']) -> Int[np.ndarray, 'unique 2']:
    """Different pairs of different numbers, sorted."""
    span = int(b.max()) + 1 if len(b) else 1
    keys = np.unique((a * span + b)[a != b])
    return np.stack([keys // span, keys % span], axis=1)
