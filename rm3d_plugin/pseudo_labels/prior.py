"""What a region may be before any network is asked: by its shape, its colour and how near revealed points lie."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from rm3d_plugin.pseudo_labels.looks import RegionExamples, looks_shares, region_looks
from rm3d_plugin.pseudo_labels.propagate import Pooled
from rm3d_plugin.pseudo_labels.spread import seeded_regions
from rm3d_plugin.regions import MergeStrategy
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import Regions

SAMPLE = 32  # points of a region whose distance is measured
OTHER_COLOR = 0.05  # likeness that is left between quite different colours


def nearness(
    xyz: Float[np.ndarray, 'points 3'],
    regions: Regions,
    true_labels: Int[np.ndarray, ' points'],
    reach: Float[np.ndarray, ' classes'],
) -> Float[np.ndarray, 'regions classes']:
    """How near the revealed points of each class are to a region: exp(-mean distance of its points / reach).

    It is divided by the root of the reach: what reaches far, as a floor, says less of each place. Of a large region
    some points, evenly chosen, stand for all.

    Args:
        xyz: Metres.
        regions: Partition of the same points.
        true_labels: True class of each point, -1 = unknown.
        reach: (C,) metres, how long regions of each class usually are; NaN, unknown: the median of the others.

    Returns:
        (R, C) not negative; 0 for classes of which the scene holds no revealed point, 1 for all where it holds none.
    """
    present = np.unique(true_labels[true_labels >= 0])
    if not len(present):
        return np.ones((len(regions), len(reach)))
    known = np.isfinite(reach)
    reach = np.where(known, reach, np.median(reach[known]) if known.any() else 1.0)
    out = np.zeros((len(regions), len(reach)))
    if not len(regions):
        return out
    steps = np.linspace(0, regions.sizes - 1, SAMPLE, axis=1).astype(np.int64)
    sample = xyz[regions.indices[regions.offsets[:-1, None] + steps]]
    for c in present.tolist():
        distance, _ = cKDTree(xyz[true_labels == c]).query(sample)
        out[:, c] = np.exp(-distance.mean(axis=1) / reach[c]) / np.sqrt(reach[c])
    return out


def color_likeness(
    colors: Float[np.ndarray, 'regions channels'],
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    sigma: float,
    count: int,
) -> Float[np.ndarray, 'regions classes']:
    """How like in colour a region is to the regions of the scene in which points of each class were revealed.

    Args:
        colors: (R, D) mean Lab colour or intensity, see :class:`rm3d_plugin.structures.RegionGraph`.
        region_labels: Region of each point, -1 = none.
        true_labels: True class of each point, -1 = unknown.
        sigma: Distance at which the likeness has fallen to 1 / e.
        count: Number of classes.

    Returns:
        (R, C) exp(-distance to the nearest such region / sigma), and a little for all, so that colour forbids nothing.
    """
    seeded = seeded_regions(region_labels, true_labels)
    out = np.full((len(colors), count), OTHER_COLOR)
    for c in np.unique(seeded.classes).tolist():
        distance = cdist(colors, colors[seeded.regions[seeded.classes == c]])
        out[:, c] += np.exp(-distance.min(axis=1) / sigma)
    return out


def region_prior(
    scene: PreparedScene,
    true_labels: Int[np.ndarray, ' points'],
    reach: Float[np.ndarray, ' classes'],
    examples: RegionExamples | None,
    strategy: MergeStrategy,
) -> Float[np.ndarray, 'regions classes']:
    """The product of :func:`looks_shares`, :func:`nearness` and :func:`color_likeness`, each where it can be told.

    Args:
        scene: Points, regions and their graph.
        true_labels: True class of each point, -1 = unknown.
        reach: See :func:`nearness`.
        examples: Labelled regions of all scenes, or None where there are none.
        strategy: Says how far colours (or intensities) may differ.
    """
    cloud, regions, graph = scene.cloud, scene.regions, scene.graph
    prior = nearness(cloud.xyz, regions, true_labels, reach)
    if graph.colors is not None:
        sigma = strategy.color_sigma if graph.colors.shape[1] == 3 else strategy.intensity_sigma
        prior = prior * color_likeness(graph.colors, regions.labels, true_labels, sigma, len(reach))
    if examples is not None:
        prior = prior * looks_shares(region_looks(cloud, regions, graph), examples, len(reach))
    return prior


def with_prior(
    pooled: Pooled | None, sizes: Int[np.ndarray, ' regions'], prior: Float[np.ndarray, 'regions classes']
) -> Pooled:
    """The pooled softmax of each region times its prior, of sum 1 again; the prior alone without a network.

    Args:
        pooled: What the network says; rows of NaN where it saw nothing. None: there is no network yet.
        sizes: Points of each region, which the prior speaks for.
        prior: (R, C) not negative.

    Returns:
        Rows of NaN where nothing is known, or nothing is left.
    """
    values, seen = (np.ones_like(prior), sizes) if pooled is None else pooled
    weighted = values * prior
    total = weighted.sum(axis=1, keepdims=True)
    return Pooled(np.where(total > 0, weighted / np.where(total > 0, total, 1.0), np.nan), seen)
