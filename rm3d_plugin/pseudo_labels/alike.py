"""Which regions look like labelled ones, anywhere in the training set: shape, height and descriptors decide."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.distance import cdist

from rm3d_plugin.structures import UNLABELLED, PointCloud, RegionGraph, Regions

LEAST_POINTS = 30  # of a region that is compared
NEIGHBORS = 10  # labelled regions that are asked
BANDWIDTH = 0.15  # squared distance at which a labelled region counts 1 / e
DOUBT = 0.5  # weight of nobody, so that far neighbours alone convince no one
DESCRIPTOR_WEIGHT = 0.5  # of the squared distance of descriptors, against 1 of shape and height
_SHAPE_COLUMNS = 7


class RegionGuess(NamedTuple):
    """What regions may be by their looks.

    Attributes:
        classes: (R,) int64, -1 = no idea.
        confidence: (R,) in [0, 1).
    """

    classes: Int[np.ndarray, ' regions']
    confidence: Float[np.ndarray, ' regions']


class RegionExamples(NamedTuple):
    """Labelled regions of all training scenes.

    Attributes:
        looks: (M, F) scaled, so that squared distances are about 1 for regions that have nothing in common.
        classes: (M,) int64.
        middle: (F,) what is taken off a look.
        scale: (F,) what it is multiplied by then.
    """

    looks: Float[np.ndarray, 'examples features']
    classes: Int[np.ndarray, ' examples']
    middle: Float[np.ndarray, ' features']
    scale: Float[np.ndarray, ' features']


def region_looks(cloud: PointCloud, regions: Regions, graph: RegionGraph) -> Float[np.ndarray, 'regions features']:
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
        return np.zeros((0, _SHAPE_COLUMNS + graph.descriptors.shape[1]))
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
    """Scale the looks of the regions of all scenes, and keep the labelled ones.

    Args:
        scenes: For each scene looks, class (-1 = unlabelled) and points of its regions.

    Returns:
        None where no region of :data:`LEAST_POINTS` is labelled.
    """
    looks: list[np.ndarray] = []
    classes: list[np.ndarray] = []
    count, total, squares = 0, np.zeros(1), np.zeros(1)
    for rows, labels, sizes in scenes:
        large = sizes >= LEAST_POINTS
        count += int(large.sum())
        total = total + rows[large].sum(axis=0)
        squares = squares + np.square(rows[large]).sum(axis=0)
        looks.append(rows[large & (labels >= 0)])
        classes.append(labels[large & (labels >= 0)])
    if not sum(map(len, classes)):
        return None
    middle = total / count
    deviation = np.sqrt(np.maximum(squares / count - np.square(middle), 0.0))
    rest = max(len(middle) - _SHAPE_COLUMNS, 1)
    share = np.where(np.arange(len(middle)) < _SHAPE_COLUMNS, 1 / _SHAPE_COLUMNS, DESCRIPTOR_WEIGHT / rest)
    told = deviation > 1e-6 * (1.0 + np.abs(middle))  # a column that is the same everywhere tells nothing
    scale = np.where(told, np.sqrt(share) / np.where(told, deviation, 1.0), 0.0)
    return RegionExamples((np.concatenate(looks) - middle) * scale, np.concatenate(classes), middle, scale)


def guess_by_looks(
    looks: Float[np.ndarray, 'regions features'],
    sizes: Int[np.ndarray, ' regions'],
    examples: RegionExamples,
    possible: Bool[np.ndarray, ' classes'],
    least: float,
) -> RegionGuess:
    """The class of the labelled regions that look most alike, where they agree and are near.

    Each of the nearest examples votes with exp(-squared distance / bandwidth). Confidence is the share of the best
    possible class of all votes (and of a constant doubt); a class that the scene does not hold takes votes and cannot
    win.

    Args:
        looks: Of the regions of one scene, see :func:`region_looks`.
        sizes: Their points; small regions are left alone.
        examples: Labelled regions of all scenes.
        possible: Classes that the scene may hold.
        least: Confidence that is needed; larger: fewer and purer guesses.
    """
    distance = cdist((looks - examples.middle) * examples.scale, examples.looks, 'sqeuclidean')
    nearest = np.argsort(distance, axis=1, kind='stable')[:, :NEIGHBORS]
    weights = np.exp(-np.take_along_axis(distance, nearest, axis=1) / BANDWIDTH)
    votes = np.zeros((len(looks), len(possible)))
    np.add.at(votes, (np.arange(len(looks))[:, None], examples.classes[nearest]), weights)
    share = np.where(possible, votes, 0.0) / (votes.sum(axis=1, keepdims=True) + DOUBT)
    confidence = share.max(axis=1, initial=0.0)
    sure = (confidence >= least) & (sizes >= LEAST_POINTS)
    classes = np.where(sure, share.argmax(axis=1), UNLABELLED).astype(np.int64)
    return RegionGuess(classes, np.where(sure, confidence, 0.0))


def possible_classes(true_labels: Int[np.ndarray, ' points'], count: int) -> Bool[np.ndarray, ' classes']:
    """The classes of which a scene holds a revealed label; all, where it holds none."""
    possible = np.zeros(count, dtype=bool)
    possible[true_labels[true_labels >= 0]] = True
    return possible if possible.any() else ~possible
