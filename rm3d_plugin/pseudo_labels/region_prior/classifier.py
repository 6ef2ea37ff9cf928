"""What annotated regions of all scenes teach of the others: how classes look to a sensor, and how frequent they are.

Budgets that show as many points of each class say nothing of how frequent classes are; what regions look like does.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.distance_prior import annotated_distances, distance_prior
from rm3d_plugin.pseudo_labels.common.kernel_classifier import (
    KernelClassifier,
    class_prior_em,
    evenly_chosen,
    fit_kernel_classifier,
    normalised,
    scaling_of,
)
from rm3d_plugin.pseudo_labels.common.sensor import (
    WIDEST,
    IntensityByRange,
    brightness,
    intensity_by_range,
    intensity_of,
    intensity_sums,
    seen_from_sensor,
)
from rm3d_plugin.pseudo_labels.ground.labels import ground_regions
from rm3d_plugin.pseudo_labels.region_prior.features import (
    DESCRIPTOR_WEIGHT,
    LEAST_POINTS,
    SHAPE_COLUMNS,
    prior_features,
)
from rm3d_plugin.regions.prepare import PreparedScene

LENGTH = 0.8  # of the kernel between features
MOST_EXAMPLES = 200  # of a class
LEAST_EXAMPLES = 15  # of all classes: fewer do not tell how likely classes are
LEAST_POINTS_OF_ONE = 5  # of a region that is an example
DOUBT = 0.01  # share of a class that was annotated in regions of several classes alone
MOST_GATHERED = 50000  # regions that wait to be chosen from
MOST_SCENES = 256  # that stand for all
SENSOR_COLUMNS = 6
_LEAST_AREA = 0.01  # m^2


class RegionRows(NamedTuple):
    """Regions of one or more scenes, as a sensor sees them.

    Attributes:
        features: (R, F) see :func:`~rm3d_plugin.pseudo_labels.region_prior.features.prior_features`.
        strengths: (R, 2) mean and deviation of the return strength, or of the brightness of colours; 0: unknown.
        ranges: (R,) metres from the sensor to the middle; 0: the sensor is unknown.
        aside: (R,) metres from the path of the sensor; 0: unknown.
        areas: (R,) square metres, the product of the two larger extents.
        sizes: (R,) points.
    """

    features: Float[np.ndarray, 'regions features']
    strengths: Float[np.ndarray, 'regions 2']
    ranges: Float[np.ndarray, ' regions']
    aside: Float[np.ndarray, ' regions']
    areas: Float[np.ndarray, ' regions']
    sizes: Int[np.ndarray, ' regions']

    def select(self, rows: Int[np.ndarray, ' kept'] | np.ndarray) -> 'RegionRows':
        """These regions alone."""
        return RegionRows(*(part[rows] for part in self))

    def columns(self, usual: IntensityByRange) -> Float[np.ndarray, 'regions columns']:
        """Features, brightness and its deviation, points a square metre and in all as if seen from 1 m, range, aside.

        Args:
            usual: Strength by range, over which brightness is taken.
        """
        bright = np.zeros((len(self.sizes), 2))
        if len(usual.ranges):
            bright = np.stack([brightness(part, self.ranges, usual) for part in self.strengths.T], axis=1)
        known = self.ranges > 0
        away = np.where(known, self.ranges, 1.0)
        nearby = np.log(np.maximum(self.sizes, 1) * away**2)
        seen = np.stack([nearby - np.log(np.maximum(self.areas, _LEAST_AREA)), nearby, np.log(away)], axis=1)
        seen[~known] = 0.0
        return np.concatenate([self.features, bright, seen, np.minimum(self.aside, WIDEST)[:, None]], axis=1)


def region_rows(scene: PreparedScene, heading: bool) -> RegionRows:
    """The regions of a scene.

    Args:
        scene: Points, regions and their graph.
        heading: Whether the sensor travels along x, as on vehicles.
    """
    cloud, regions, graph = scene.cloud, scene.regions, scene.graph
    count, inside = len(regions), regions.labels >= 0
    own, sizes = regions.labels[inside], np.maximum(regions.sizes, 1)

    def mean(values: Float[np.ndarray, ' points']) -> Float[np.ndarray, ' regions']:
        return np.bincount(own, values[inside], minlength=count) / sizes

    strength, ranges, aside = intensity_of(cloud), np.zeros(count), np.zeros(count)
    strengths = np.zeros((count, 2))
    if strength is not None:
        middle = mean(strength)
        strengths = np.stack([middle, np.sqrt(np.maximum(mean(strength**2) - middle**2, 0.0))], axis=1)
    if cloud.sensor is not None:
        middles = np.stack([mean(axis) for axis in seen_from_sensor(cloud).T], axis=1)
        ranges = np.maximum(np.linalg.norm(middles, axis=1), 1e-3)
        aside = np.abs(middles[:, 1]) if heading else aside
    areas = np.sort(graph.extents, axis=1)[:, 1:].prod(axis=1)
    return RegionRows(prior_features(cloud, regions, graph), strengths, ranges, aside, areas, regions.sizes)


class RegionKnowledge(NamedTuple):
    """What annotated regions teach.

    Attributes:
        usual: Return strength by range.
        classes: Taught by annotated regions.
        frequencies: (C,) share of each class in the points of the scenes where it stands.
        heading: See :func:`region_rows`.
    """

    usual: IntensityByRange
    classes: KernelClassifier
    frequencies: Float[np.ndarray, ' classes']
    heading: bool

    def shares(self, scene: PreparedScene) -> Float[np.ndarray, 'regions classes']:
        """How likely each class is for the regions of a scene by their features, times how frequent it is.

        Classes that no region teaches have :data:`DOUBT`, so that a network may still name them.
        """
        rows = region_rows(scene, self.heading).columns(self.usual)
        said = normalised(self.classes.shares(rows, len(self.frequencies)) * self.frequencies)
        return np.where(np.isin(np.arange(said.shape[1]), self.classes.classes), said, DOUBT)


class _Scanned(NamedTuple):
    """A scene that stands for others: its regions, whether they stand, and (R, C) metres to the nearest clicks."""

    rows: RegionRows
    standing: Bool[np.ndarray, ' regions']
    distance: Float[np.ndarray, 'regions classes']


class RegionCollector:
    """Gathers regions scene by scene, then learns from them.

    Args:
        heading: See :func:`region_rows`.
        min_upright: Regions so upright are named point by point elsewhere: they teach what ground is, but have no part
            in how frequent classes are. None: no region is so.
    """

    def __init__(self, heading: bool, min_upright: float | None) -> None:
        self._heading, self._min_upright = heading, min_upright
        self._examples: list[RegionRows] = []
        self._classes: list[Int[np.ndarray, ' _examples']] = []
        self._scenes: list[_Scanned] = []
        self._seen, self._step = 0, 1

    def add(
        self,
        scene: PreparedScene,
        classes: Int[np.ndarray, ' regions'],
        annotated: Int[np.ndarray, ' points'],
        count: int,
    ) -> None:
        """Take in a scene.

        Args:
            scene: Points, regions and their graph.
            classes: The only class annotated in each region; -1: none, or several.
            annotated: Annotated class of each point, -1 = none.
            count: Number of classes.
        """
        rows = region_rows(scene, self._heading)
        known = np.flatnonzero((classes >= 0) & (rows.sizes >= LEAST_POINTS_OF_ONE))
        self._examples.append(rows.select(known))
        self._classes.append(classes[known])
        if sum(map(len, self._classes)) > MOST_GATHERED:
            labels = np.concatenate(self._classes)
            kept = np.sort(evenly_chosen(labels, 2 * MOST_EXAMPLES))
            self._examples, self._classes = [_joined(self._examples).select(kept)], [labels[kept]]
        if self._seen % self._step == 0 and len(classes):
            distance = annotated_distances(scene.cloud.xyz, scene.regions, annotated, count)
            self._scenes.append(_Scanned(rows, ~ground_regions(scene.graph, self._min_upright), distance))
        self._seen += 1
        if len(self._scenes) > MOST_SCENES:
            self._scenes, self._step = self._scenes[::2], 2 * self._step

    def learn(self, lengths: Float[np.ndarray, ' classes'], scale: float | None) -> RegionKnowledge | None:
        """What was gathered; None where fewer than :data:`LEAST_EXAMPLES` regions were clicked.

        Args:
            lengths: See :func:`~rm3d_plugin.pseudo_labels.common.distance_prior.distance_prior`.
            scale: See there.
        """
        if sum(map(len, self._classes)) < LEAST_EXAMPLES:
            return None
        every = _joined([scene.rows for scene in self._scenes])
        usual = intensity_by_range(intensity_sums(every.ranges, every.strengths[:, 0], every.sizes))
        columns = every.columns(usual)
        large = every.sizes >= LEAST_POINTS
        scaling = scaling_of(columns[large] if large.any() else columns, _column_weights(columns.shape[1]))
        labels = np.concatenate(self._classes)
        chosen = evenly_chosen(labels, MOST_EXAMPLES)
        examples = _joined(self._examples).select(chosen).columns(usual)
        classes = fit_kernel_classifier(examples, labels[chosen], scaling, LENGTH)
        standing = np.concatenate([scene.standing for scene in self._scenes])
        near = np.concatenate([distance_prior(scene.distance, lengths, scale) for scene in self._scenes])[standing]
        shares = classes.shares(columns[standing], near.shape[1]) * near
        frequencies = class_prior_em(shares, every.sizes[standing], near > 0)
        return RegionKnowledge(usual, classes, frequencies, self._heading)


def _joined(parts: list[RegionRows]) -> RegionRows:
    return RegionRows(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _column_weights(count: int) -> Float[np.ndarray, ' columns']:
    """Shape and height weigh 1 together, descriptors :data:`DESCRIPTOR_WEIGHT`; what a sensor sees weighs as shape."""
    descriptors = count - SHAPE_COLUMNS - SENSOR_COLUMNS
    weights = np.full(count, 1.0 / SHAPE_COLUMNS)
    weights[SHAPE_COLUMNS : SHAPE_COLUMNS + descriptors] = DESCRIPTOR_WEIGHT / max(descriptors, 1)
    return weights
