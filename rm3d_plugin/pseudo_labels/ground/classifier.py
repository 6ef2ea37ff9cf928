"""Ground by its features: annotated points of all scenes teach what road, pavement and grass look like.

In each scene what the features say is weighed with how near its own annotated points lie. This needs no network, so it
names ground in the first round already.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from rm3d_plugin.pseudo_labels.common.distance_prior import distance_decay
from rm3d_plugin.pseudo_labels.common.kernel_classifier import (
    KernelClassifier,
    class_prior_em,
    evenly_chosen,
    fit_kernel_classifier,
    scaling_of,
)
from rm3d_plugin.pseudo_labels.common.sensor import IntensityByRange, range_normalised_intensity
from rm3d_plugin.pseudo_labels.ground.features import ground_features
from rm3d_plugin.pseudo_labels.ground.labels import FAR, GroundLabels
from rm3d_plugin.structures import UNLABELLED, PointCloud

PLANE_STEP = 0.06  # m above the plane of the ground that count as a metre sideways
ALONG = 0.07  # m sideways that a metre along the street counts
LENGTH = 1.5  # of the kernel between features
MOST_EXAMPLES = 300  # of a class
MOST_GATHERED = 100000  # points that wait to be chosen from
LEAST_EXAMPLES = 100  # of all classes: fewer do not tell what ground looks like
SAMPLE = 200000  # points of all scenes that stand for the others

GroundScene = tuple[PointCloud, Bool[np.ndarray, ' points'], Int[np.ndarray, ' points']]


class GroundKnowledge(NamedTuple):
    """What the annotated ground points of all scenes say of ground anywhere.

    Attributes:
        usual: Return strength by range.
        classes: Taught by annotated points.
        frequencies: (K,) how frequent ``classes.classes`` are among ground points.
        heading: See :func:`~rm3d_plugin.pseudo_labels.ground.features.ground_features`.
    """

    usual: IntensityByRange
    classes: KernelClassifier
    frequencies: Float[np.ndarray, ' classes']
    heading: bool

    def labels(
        self,
        cloud: PointCloud,
        ground: Bool[np.ndarray, ' points'],
        annotated: Int[np.ndarray, ' points'],
        count: int,
    ) -> GroundLabels:
        """The class of each ground point of a scene, by its features and by annotated points nearby.

        What the features say of a class is multiplied with how likely it is by its nearest annotated point, ground or
        not (:func:`~rm3d_plugin.pseudo_labels.common.distance_prior.distance_decay`, 1 m, at least as at :data:`FAR`).
        Heights, above the plane of the ground, count 1 / :data:`PLANE_STEP` times; where the heading is known, x counts
        :data:`ALONG` times. Classes without an annotated point in the scene are not said.

        Args:
            cloud: Points, metres, z up.
            ground: Points that are asked about.
            annotated: Annotated class of each point, -1 = none.
            count: Number of classes.
        """
        classes, confidence = np.full(len(ground), UNLABELLED, dtype=np.int64), np.zeros(len(ground))
        rows = np.flatnonzero(ground)
        if not len(rows):
            return GroundLabels(classes, confidence)
        features = ground_features(cloud, ground, self.usual, self.heading)
        said = self.classes.shares(features.rows, count)
        said[:, self.classes.classes] *= self.frequencies
        stretch = np.array([ALONG if self.heading else 1.0, 1.0, 1.0 / PLANE_STEP])
        where = np.column_stack([cloud.xyz[:, :2], features.heights]) * stretch
        shares = np.zeros_like(said)
        for c in np.unique(annotated[annotated >= 0]).tolist():
            distance, _ = cKDTree(where[annotated == c]).query(where[rows])
            shares[:, c] = said[:, c] * distance_decay(np.minimum(distance, FAR), 1.0)
        total = shares.sum(axis=1)
        named = total > 0
        classes[rows[named]] = shares[named].argmax(axis=1)
        confidence[rows[named]] = shares[named].max(axis=1) / total[named]
        return GroundLabels(classes, confidence)


def learn_ground(scenes: Callable[[], Iterable[GroundScene]], heading: bool) -> GroundKnowledge | None:
    """Learn from the annotated ground points of all scenes; reads every scene twice.

    Args:
        scenes: Gives points, which of them are ground, and their annotated classes (-1 = none), of every scene.
        heading: See :func:`~rm3d_plugin.pseudo_labels.ground.features.ground_features`.

    Returns:
        None where fewer than :data:`LEAST_EXAMPLES` ground points are annotated.
    """
    points = known = 0

    def counted() -> Iterator[tuple[PointCloud, Bool[np.ndarray, ' points']]]:
        nonlocal points, known
        for cloud, ground, annotated in scenes():
            points, known = points + int(ground.sum()), known + int((annotated[ground] >= 0).sum())
            yield cloud, ground

    usual = range_normalised_intensity(counted())
    if known < LEAST_EXAMPLES:
        return None
    share = max(1, points // SAMPLE)
    rows: list[np.ndarray] = []
    labels: list[np.ndarray] = []
    sample: list[np.ndarray] = []
    for cloud, ground, annotated in scenes():
        features, own = ground_features(cloud, ground, usual, heading).rows, annotated[ground]
        if not len(own):
            continue
        rows.append(features[own >= 0])
        labels.append(own[own >= 0])
        sample.append(features[::share])
        if sum(map(len, labels)) > MOST_GATHERED:
            rows, labels = _thinned(rows, labels)
    examples, classes, at_large = np.concatenate(rows), np.concatenate(labels), np.concatenate(sample)
    kept = evenly_chosen(classes, MOST_EXAMPLES)
    taught = fit_kernel_classifier(examples[kept], classes[kept], scaling_of(at_large), LENGTH)
    frequencies = class_prior_em(taught.shares(at_large, int(classes.max()) + 1)[:, taught.classes])
    return GroundKnowledge(usual, taught, frequencies, heading)


def _thinned(rows: list[np.ndarray], labels: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Twice as many examples of a class as are asked for, at most."""
    every = np.concatenate(labels)
    kept = np.sort(evenly_chosen(every, 2 * MOST_EXAMPLES))
    return [np.concatenate(rows)[kept]], [every[kept]]
