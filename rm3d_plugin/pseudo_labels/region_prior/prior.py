"""What a region may be before any network is asked: by its features, its colour and how near annotated points lie."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist

from rm3d_plugin.pseudo_labels.common.annotated import annotated_region_classes
from rm3d_plugin.pseudo_labels.common.distance_prior import annotated_distances, distance_prior
from rm3d_plugin.pseudo_labels.common.groups import Pooled
from rm3d_plugin.pseudo_labels.region_prior.classifier import RegionKnowledge
from rm3d_plugin.pseudo_labels.region_prior.features import RegionExamples, knn_class_prior, prior_features
from rm3d_plugin.pseudo_labels.region_prior.rules import RegionPriorRules
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import Regions

OTHER_COLOR = 0.05  # likeness that is left between quite different colours


def color_likeness(
    colors: Float[np.ndarray, 'regions channels'],
    region_labels: Int[np.ndarray, ' points'],
    annotated: Int[np.ndarray, ' points'],
    sigma: float,
    count: int,
) -> Float[np.ndarray, 'regions classes']:
    """How like in colour a region is to the regions of the scene in which points of each class were annotated.

    Args:
        colors: (R, D) mean Lab colour or intensity, see :class:`rm3d_plugin.structures.RegionGraph`.
        region_labels: Region of each point, -1 = none.
        annotated: Annotated class of each point, -1 = none.
        sigma: Distance at which the likeness has fallen to 1 / e.
        count: Number of classes.

    Returns:
        (R, C) exp(-distance to the nearest such region / sigma), and a little for all, so that colour forbids nothing.
    """
    seeded = annotated_region_classes(region_labels, annotated)
    out = np.full((len(colors), count), OTHER_COLOR)
    for c in np.unique(seeded.classes).tolist():
        distance = cdist(colors, colors[seeded.regions[seeded.classes == c]])
        out[:, c] += np.exp(-distance.min(axis=1) / sigma)
    return out


def classless_regions(
    regions: Regions, annotated: Int[np.ndarray, ' points'], missing_points: float | None
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
    known = annotated >= 0
    held = np.bincount(regions.labels[known & (regions.labels >= 0)], minlength=len(regions))
    return np.asarray((held == 0) & (regions.sizes * known.mean() >= missing_points))


def region_prior(
    scene: PreparedScene,
    annotated: Int[np.ndarray, ' points'],
    lengths: Float[np.ndarray, ' classes'],
    known: RegionExamples | RegionKnowledge | None,
    rules: RegionPriorRules,
) -> Float[np.ndarray, 'regions classes']:
    """What places and region features say, multiplied; rows of sum 1, of NaN where nothing is possible.

    That is :func:`~rm3d_plugin.pseudo_labels.common.distance_prior.distance_prior` and :class:`RegionKnowledge`, or
    else :func:`knn_class_prior` and :func:`color_likeness`, each where it can be told. Nothing is possible in
    :func:`classless_regions`.

    Args:
        scene: Points, regions and their graph.
        annotated: Annotated class of each point, -1 = none.
        lengths: See :func:`~rm3d_plugin.pseudo_labels.common.distance_prior.distance_prior`.
        known: What annotated regions of all scenes teach, or None where there are none.
        rules: Say how far places and colours (or intensities) may differ.
    """
    cloud, regions, graph, count = scene.cloud, scene.regions, scene.graph, len(lengths)
    distance = annotated_distances(cloud.xyz, regions, annotated, count)
    prior = distance_prior(distance, lengths, rules.distance_scale)
    if isinstance(known, RegionKnowledge):
        prior = prior * known.shares(scene)
    elif graph.colors is not None:
        sigma = rules.color_sigma if graph.colors.shape[1] == 3 else rules.intensity_sigma
        prior = prior * color_likeness(graph.colors, regions.labels, annotated, sigma, count)
    if isinstance(known, RegionExamples):
        prior = prior * knn_class_prior(prior_features(cloud, regions, graph), known, count)
    prior[classless_regions(regions, annotated, rules.missing_points)] = 0.0
    return _of_sum_one(prior)


def with_prior(pooled: Pooled, prior: Float[np.ndarray, 'regions classes'], power: float = 1.0) -> Pooled:
    """The pooled softmax of each region to a power, times its prior, of sum 1 again.

    Args:
        pooled: What the network says; rows of NaN where it saw nothing.
        prior: (R, C) not negative; see :func:`region_prior`.
        power: Inverse temperature; larger: the network counts more.

    Returns:
        Rows of NaN where nothing is known, or nothing is left.
    """
    return pooled._replace(values=_of_sum_one(pooled.values**power * prior))


def _of_sum_one(rows: Float[np.ndarray, 'regions classes']) -> Float[np.ndarray, 'regions classes']:
    total = rows.sum(axis=1, keepdims=True)
    return np.where(total > 0, rows / np.where(total > 0, total, 1.0), np.nan)
