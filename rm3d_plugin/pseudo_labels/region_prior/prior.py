"""What a region may be before any network is asked: by its shape, its colour and how near annotated points lie."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist

from rm3d_plugin.pseudo_labels.common.distance_prior import annotated_distances, nearness
from rm3d_plugin.pseudo_labels.common.groups import Pooled
from rm3d_plugin.pseudo_labels.region_prior.classifier import RegionKnowledge
from rm3d_plugin.pseudo_labels.region_prior.features import RegionExamples, looks_shares, region_looks
from rm3d_plugin.pseudo_labels.segmentation.propagation import seeded_regions
from rm3d_plugin.regions import MergeStrategy
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import Regions

OTHER_COLOR = 0.05  # likeness that is left between quite different colours


def color_likeness(
    colors: Float[np.ndarray, 'regions channels'],
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    sigma: float,
    count: int,
) -> Float[np.ndarray, 'regions classes']:
    """How like in colour a region is to the regions of the scene in which points of each class were annotated.

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


def classless_regions(
    regions: Regions, true_labels: Int[np.ndarray, ' points'], missing_points: float | None
) -> Bool[np.ndarray, ' regions']:
    """Regions that would hold so many annotated points or more, were these spread evenly, but hold none.

    Where points are annotated by chance, those are things of no class: one of a class is missed with a probability of
    exp(-``missing_points``). None: no region is.

    >>> regions = Regions(np.repeat([0, 1, 2], [4, 4, 2]))
    >>> classless_regions(regions, np.array([0, 0, 1, -1, -1, -1, -1, -1, 1, -1]), 1.5)
    array([False,  True, False])
    """
    if missing_points is None:
        return np.zeros(len(regions), dtype=bool)
    annotated = true_labels >= 0
    held = np.bincount(regions.labels[annotated & (regions.labels >= 0)], minlength=len(regions))
    return np.asarray((held == 0) & (regions.sizes * annotated.mean() >= missing_points))


def region_prior(
    scene: PreparedScene,
    true_labels: Int[np.ndarray, ' points'],
    lengths: Float[np.ndarray, ' classes'],
    looks: RegionExamples | RegionKnowledge | None,
    strategy: MergeStrategy,
) -> Float[np.ndarray, 'regions classes']:
    """What places and looks say, multiplied.

    That is :func:`~rm3d_plugin.pseudo_labels.common.distance_prior.nearness` and :class:`RegionKnowledge`, or else
    :func:`looks_shares` and :func:`color_likeness`, each where it can be told. It is 0 for all classes in
    :func:`classless_regions`.

    Args:
        scene: Points, regions and their graph.
        true_labels: True class of each point, -1 = unknown.
        lengths: See :func:`~rm3d_plugin.pseudo_labels.common.distance_prior.nearness`.
        looks: What labelled regions of all scenes say, or None where there are none.
        strategy: Says how far places and colours (or intensities) may differ.
    """
    cloud, regions, graph, count = scene.cloud, scene.regions, scene.graph, len(lengths)
    distance = annotated_distances(cloud.xyz, regions, true_labels, count)
    prior = nearness(distance, lengths, strategy.prior_scale)
    if isinstance(looks, RegionKnowledge):
        prior = prior * looks.shares(scene)
    elif graph.colors is not None:
        sigma = strategy.color_sigma if graph.colors.shape[1] == 3 else strategy.intensity_sigma
        prior = prior * color_likeness(graph.colors, regions.labels, true_labels, sigma, count)
    if isinstance(looks, RegionExamples):
        prior = prior * looks_shares(region_looks(cloud, regions, graph), looks, count)
    prior[classless_regions(regions, true_labels, strategy.missing_points)] = 0.0
    return prior


def with_prior(
    pooled: Pooled | None,
    sizes: Int[np.ndarray, ' regions'],
    prior: Float[np.ndarray, 'regions classes'],
    power: float = 1.0,
) -> Pooled:
    """The pooled softmax of each region to a power, times its prior, of sum 1 again; the prior alone without a network.

    Args:
        pooled: What the network says; rows of NaN where it saw nothing. None: there is no network yet.
        sizes: Points of each region, which the prior speaks for.
        prior: (R, C) not negative.
        power: Larger: the network counts more.

    Returns:
        Rows of NaN where nothing is known, or nothing is left.
    """
    values, seen = (np.ones_like(prior), sizes) if pooled is None else pooled
    weighted = values**power * prior
    total = weighted.sum(axis=1, keepdims=True)
    return Pooled(np.where(total > 0, weighted / np.where(total > 0, total, 1.0), np.nan), seen)
