"""How much there is to learn from a region, and which regions are alike (ReDAL, ICCV 2021)."""

import warnings

import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.vq import kmeans2

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.structures import PointCloud

NEIGHBORS = 50  # of a point, for gradient and variation; the publication's, as the next two and the decay
GRADIENT, VARIATION = 0.1, 0.05  # weights beside the entropy's 1
CLIPPED = 0.1  # greatest gradient and variation that count
DECAY = 0.95  # what one region of a cluster before it leaves of a region's score
CLUSTERS = 20  # of alike regions; ours
BLOCK = 20_000  # points whose neighbours are looked at together


def class_entropy(shares: Float[np.ndarray, 'rows classes']) -> Float[np.ndarray, ' rows']:
    """Mean over the classes of -p log2 p; NaN where the shares are.

    >>> class_entropy(np.array([[0.5, 0.5], [1.0, 0.0], [np.nan, np.nan]])).round(2).tolist()
    [0.5, 0.0, nan]
    """
    return np.asarray(-(shares * np.log2(np.maximum(shares, 1e-12))).mean(axis=1)) + 0.0  # no negative zero


def surface_interest(cloud: PointCloud) -> Float[np.ndarray, ' points']:
    """The part of the score that needs no network: weighted colour gradient and surface variation of each point.

    The gradient is the mean difference of the colours, in [0, 1], from those of the neighbours; the variation is the
    least eigenvalue of their covariance over the sum of the three.

    Args:
        cloud: N points; without colours the gradient is 0.
    """
    tree, out = Octree(cloud.xyz), np.zeros(len(cloud))
    count = min(NEIGHBORS, len(cloud))
    for start in range(0, len(cloud), BLOCK):
        rows = np.arange(start, min(start + BLOCK, len(cloud)))
        near = tree.knn(cloud.xyz[rows], count).indices
        apart = cloud.xyz[near].astype(np.float64)
        apart -= apart.mean(axis=1, keepdims=True)
        lengths = np.linalg.eigvalsh(np.einsum('nki,nkj->nij', apart, apart))
        variation = np.maximum(lengths[:, 0], 0.0) / np.maximum(lengths.sum(axis=1), 1e-300)
        out[rows] = VARIATION * np.minimum(variation, CLIPPED)
        if cloud.colors is not None:
            gradient = np.abs(cloud.colors[near].astype(np.float64) - cloud.colors[rows, None]).mean(axis=(1, 2))
            out[rows] += GRADIENT * np.minimum(gradient, CLIPPED)
    return out


def alike(
    features: Float[np.ndarray, 'regions channels'], rng: np.random.Generator, count: int = CLUSTERS
) -> Int[np.ndarray, ' regions']:
    """Cluster of each region: k-means of the features, each channel in units of its spread.

    Args:
        features: One row a region, at least one.
        rng: Chooses the first middles.
        count: Clusters; fewer where there are fewer regions. Larger: only regions that are more alike share one.
    """
    rows = features.astype(np.float64)
    rows = rows / np.maximum(rows.std(axis=0), 1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', UserWarning)  # an empty cluster does no harm
        return np.asarray(kmeans2(rows, min(count, len(rows)), minit='++', rng=rng)[1], dtype=np.int64)


def decayed(
    scores: Float[np.ndarray, ' regions'], clusters: Int[np.ndarray, ' regions']
) -> Float[np.ndarray, ' regions']:
    """Scores times .95^n, n being the regions of the same cluster with a higher score; ties count by their order.

    >>> decayed(np.array([1.0, 2.0, 2.0]), np.array([0, 0, 1])).tolist()
    [0.95, 2.0, 2.0]
    """
    order = np.lexsort((-scores, clusters))  # cluster by cluster, best first; stable
    ordered = clusters[order]
    before = np.empty(len(order), dtype=np.int64)
    before[order] = np.arange(len(order)) - np.searchsorted(ordered, ordered)
    return np.asarray(scores * DECAY**before)


def asked_of_regions(
    scores: Float[np.ndarray, ' regions'],
    clusters: Int[np.ndarray, ' regions'],
    shown: Int[np.ndarray, ' regions'],
    free: Int[np.ndarray, ' regions'],
    count: int,
) -> Int[np.ndarray, ' regions']:
    """How many points of each region are asked for: one of the best, and again only where all have been asked.

    Args:
        scores: Larger: rather asked.
        clusters: Regions that are alike; see :func:`decayed`.
        shown: Annotated points of each region; those with the fewest come first.
        free: Points of each region that are not annotated.
        count: Points to ask for in all; fewer where the regions have no more.
    """
    asked = np.zeros(len(scores), dtype=np.int64)
    while (left := count - int(asked.sum())) > 0 and (open := asked < free).any():
        known = shown + asked
        lowest = np.flatnonzero(open & (known == known[open].min()))
        order = np.argsort(-decayed(scores[lowest], clusters[lowest]), kind='stable')
        asked[lowest[order[:left]]] += 1
    return asked
