"""Regions of several sizes and what they look like: means over many points tell classes apart where points do not."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.kernel_classifier import Scaling, scaling_of
from rm3d_plugin.pseudo_labels.propagation.coarsening import coarsen
from rm3d_plugin.pseudo_labels.propagation.point_graph import PointGraph

POINTS = (4, 13, 40, 120)  # of a region, about
MOST_REGIONS = 80_000  # of one size, beside the largest: more take too long


class RegionScale(NamedTuple):
    """A partition of the points.

    Attributes:
        region: (N,) of each point.
        sizes: (R,) points of each region.
        features: (R, F) float32 means of the points.
        scaling: Of the features.
    """

    region: Int[np.ndarray, ' points']
    sizes: Int[np.ndarray, ' regions']
    features: Float[np.ndarray, 'regions features']
    scaling: Scaling

    def mean(self, values: Float[np.ndarray, 'points columns']) -> Float[np.ndarray, 'regions columns']:
        """Means of the points of each region."""
        return region_means(values, self.region, self.sizes)


def region_scales(graph: PointGraph, groups: Iterable[Float[np.ndarray, 'points columns']]) -> tuple[RegionScale, ...]:
    """Join points along their heaviest edges to regions, and these to larger ones; finest first.

    Args:
        graph: Of the points.
        groups: Columns of features of the points, some at a time.
    """
    partitions = _partitions(graph)
    parts: list[list[np.ndarray]] = [[] for _ in partitions]
    for group in groups:
        for own, (region, sizes) in zip(parts, partitions, strict=True):
            own.append(region_means(group, region, sizes).astype(np.float32))
    features = [np.concatenate(own, axis=1) for own in parts]
    return tuple(
        RegionScale(region, sizes, each, scaling_of(each if len(each) else np.zeros((1, each.shape[1]))))
        for (region, sizes), each in zip(partitions, features, strict=True)
    )


def region_means(
    values: Float[np.ndarray, 'points columns'], region: Int[np.ndarray, ' points'], sizes: Int[np.ndarray, ' regions']
) -> Float[np.ndarray, 'regions columns']:
    """Means of the points of each region, float64."""
    count = len(values)
    gather = scipy.sparse.csr_array((np.ones(count), (region, np.arange(count))), shape=(len(sizes), count))
    return np.asarray((gather @ values.astype(np.float64)) / np.maximum(sizes, 1)[:, None])


def _partitions(graph: PointGraph) -> list[tuple[Int[np.ndarray, ' points'], Int[np.ndarray, ' regions']]]:
    count, nobody = graph.weights.shape[0], np.zeros(0, np.int64)
    region, weights, out = np.arange(count), graph.weights, []
    for points in POINTS:
        coarse = coarsen(PointGraph(weights, graph.degree), nobody, count // points)
        region, weights = coarse.node[region], coarse.weights
        if count // points <= MOST_REGIONS or points == POINTS[-1]:
            out.append((region, np.bincount(region, minlength=weights.shape[0])))
    return out
