"""What regions look like, and which annotated regions, anywhere in the training set, look like them."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.distance import cdist

from rm3d_plugin.structures import PointCloud, RegionGraph, Regions

LEAST_POINTS = 30  # of a region that is an example
NEIGHBORS = 10  # annotated regions that are asked
BANDWIDTH = 0.15  # squared distance at which an annotated region counts 1 / e
DOUBT = 0.1  # votes that each class has for nothing, so that far neighbours alone convince no one
DESCRIPTOR_WEIGHT = 0.5  # of the squared distance of descriptors, against 1 of shape and height
SHAPE_COLUMNS = 7


class RegionExamples(NamedTuple):
    """Labelled regions of all training scenes.

    Attributes:
        features: (M, F) scaled, so that squared distances are about 1 for regions that have nothing in common.
        classes: (M,) int64.
        middle: (F,) what is taken off a feature.
        scale: (F,) what it is multiplied by then.
    """

    features: Float[np.ndarray, 'examples features']
    classes: Int[np.ndarray, ' examples']
    middle: Float[np.ndarray, ' features']
    scale: Float[np.ndarray, ' features']


def prior_features(cloud: PointCloud, regions: Regions, graph: RegionGraph) -> Float[np.ndarray, 'regions features']:
    """Slope, curvature, three lengths, lower and upper end above the scene's floor, then the mean descriptor.

    Nothing in it changes when the scene is turned about z or moved. Colours are left out: they tell things of one scene
    apart, and differ between scenes.

    Args:
        cloud: Points, metres, z up.
        regions: Partition of the same points.
        graph: Features of the regions.
    """
    count = len(regions)
    if count == 0:
        return np.zeros((0, SHAPE_COLUMNS + graph.descriptors.shape[1]))
    z, order = cloud.xyz[:, 2].astype(np.float64), regions.indices
    floor = np.percentile(z, 1)
    low = np.minimum.reduceat(z[order], regions.offsets[:-1]) - floor
    high = np.maximum.reduceat(z[order], regions.offsets[:-1]) - floor
    shape = np.column_stack([np.abs(graph.normals[:, 2]), graph.curvatures, np.log(graph.extents + 0.05), low, high])
    return np.concatenate([shape, graph.descriptors], axis=1)


def collect_examples(
    scenes: Iterable[
        tuple[Float[np.ndarray, 'regions features'], Int[np.ndarray, ' regions'], Int[np.ndarray, ' regions']]
    ],
) -> RegionExamples | None:
    """Scale the features of the regions of all scenes, and keep the annotated ones.

    Args:
        scenes: For each scene features, class (-1 = unlabelled) and points of its regions.

    Returns:
        None where no region of :data:`LEAST_POINTS` is labelled.
    """
    features: list[np.ndarray] = []
    classes: list[np.ndarray] = []
    count, total, squares = 0, np.zeros(1), np.zeros(1)
    for rows, labels, sizes in scenes:
        large = sizes >= LEAST_POINTS
        count += int(large.sum())
        total = total + rows[large].sum(axis=0)
        squares = squares + np.square(rows[large]).sum(axis=0)
        features.append(rows[large & (labels >= 0)])
        classes.append(labels[large & (labels >= 0)])
    if not sum(map(len, classes)):
        return None
    middle = total / count
    deviation = np.sqrt(np.maximum(squares / count - np.square(middle), 0.0))
    rest = max(len(middle) - SHAPE_COLUMNS, 1)
    share = np.where(np.arange(len(middle)) < SHAPE_COLUMNS, 1 / SHAPE_COLUMNS, DESCRIPTOR_WEIGHT / rest)
    told = deviation > 1e-6 * (1.0 + np.abs(middle))  # a column that is the same everywhere tells nothing
    scale = np.where(told, np.sqrt(share) / np.where(told, deviation, 1.0), 0.0)
    return RegionExamples((np.concatenate(features) - middle) * scale, np.concatenate(classes), middle, scale)


def knn_class_prior(
    features: Float[np.ndarray, 'regions features'], examples: RegionExamples, count: int
) -> Float[np.ndarray, 'regions classes']:
    """How much the annotated regions that look most alike speak for each class.

    Each of the nearest examples votes with exp(-squared distance / bandwidth), and each class has a little for nothing.

    Args:
        features: Of the regions of one scene, see :func:`prior_features`.
        examples: Labelled regions of all scenes.
        count: Number of classes.

    Returns:
        (R, C) rows of sum 1; alike for all classes where nothing is near.
    """
    distance = cdist((features - examples.middle) * examples.scale, examples.features, 'sqeuclidean')
    asked = min(NEIGHBORS, len(examples.features))
    nearest = np.argpartition(distance, asked - 1, axis=1)[:, :asked]
    weights = np.exp(-np.take_along_axis(distance, nearest, axis=1) / BANDWIDTH)
    votes = np.full((len(features), count), DOUBT)
    np.add.at(votes, (np.arange(len(features))[:, None], examples.classes[nearest]), weights)
    return np.asarray(votes / votes.sum(axis=1, keepdims=True))
