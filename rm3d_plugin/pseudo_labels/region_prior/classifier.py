"""What clicked regions of all scenes teach of the others: how classes look to a sensor, and how frequent they are.

Budgets that show as many points of each class say nothing of how frequent classes are; what regions look like does.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.pseudo_labels.common.distance_prior import annotated_distances, nearness
from rm3d_plugin.pseudo_labels.common.kernel_classifier import (
    KernelClasses,
    class_prior_em,
    evenly_chosen,
    fit_kernel_classes,
    normalised,
    scaling_of,
)
from rm3d_plugin.pseudo_labels.common.sensor import (
    WIDEST,
    UsualStrength,
    brightness,
    seen_from_sensor,
    strength_of,
    strength_sums,
    usual_of,
)
from rm3d_plugin.pseudo_labels.ground.labels import level_regions
from rm3d_plugin.pseudo_labels.region_prior.features import DESCRIPTOR_WEIGHT, LEAST_POINTS, SHAPE_COLUMNS, region_looks
from rm3d_plugin.regions.prepare import PreparedScene

LENGTH = 0.8  # of the kernel between looks
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
        looks: (R, F) see :func:`~rm3d_plugin.pseudo_labels.region_prior.features.region_looks`.
        strengths: (R, 2) mean and deviation of the return strength, or of the brightness of colours; 0: unknown.
        ranges: (R,) metres from the sensor to the middle; 0: the sensor is unknown.
        aside: (R,) metres from the path of the sensor; 0: unknown.
        areas: (R,) square metres, the product of the two larger extents.
        sizes: (R,) points.
    """

    looks: Float[np.ndarray, 'regions features']
    strengths: Float[np.ndarray, 'regions 2']
    ranges: Float[np.ndarray, ' regions']
    aside: Float[np.ndarray, ' regions']
    areas: Float[np.ndarray, ' regions']
    sizes: Int[np.ndarray, ' regions']

    def select(self, rows: Int[np.ndarray, ' kept'] | np.ndarray) -> 'RegionRows':
        """These regions alone."""
        return RegionRows(*(part[rows] for part in self))

    def columns(self, usual: UsualStrength) -> Float[np.ndarray, 'regions columns']:
        """Looks, brightness and its deviation, points a square metre and in all as if seen from 1 m, range, aside.

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
        return np.concatenate([self.looks, bright, seen, np.minimum(self.aside, WIDEST)[:, None]], axis=1)


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

    strength, ranges, aside = strength_of(cloud), np.zeros(count), np.zeros(count)
    strengths = np.zeros((count, 2))
    if strength is not None:
        middle = mean(strength)
        strengths = np.stack([middle, np.sqrt(np.maximum(mean(strength**2) - middle**2, 0.0))], axis=1)
    if cloud.sensor is not None:
        middles = np.stack([mean(axis) for axis in seen_from_sensor(cloud).T], axis=1)
        ranges = np.maximum(np.linalg.norm(middles, axis=1), 1e-3)
        aside = np.abs(middles[:, 1]) if heading else aside
    areas = np.sort(graph.extents, axis=1)[:, 1:].prod(axis=1)
    return RegionRows(region_looks(cloud, regions, graph), strengths, ranges, aside, areas, regions.sizes)


class RegionKnowledge(NamedTuple):
    """What clicked regions teach.

    Attributes:
        usual: Return strength by range.
        classes: Taught by clicked regions.
        frequencies: (C,) share of each class in the points of the scenes where it stands.
        heading: See :func:`region_rows`.
    """

    usual: UsualStrength
    classes: KernelClasses
    frequencies: Float[np.ndarray, ' classes']
    heading: bool

    def shares(self, scene: PreparedScene) -> Float[np.ndarray, 'regions classes']:
        """How likely each class is for the regions of a scene by their looks, times how frequent it is.

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
        level: Regions so upright are named point by point elsewhere: they teach what ground is, but have no part in how
            frequent classes are. None: no region is so.
    """

    def __init__(self, heading: bool, level: float | None) -> None:
        self._heading, self._level = heading, level
        self._examples: list[RegionRows] = []
        self._classes: list[Int[np.ndarray, ' _examples']] = []
        self._scenes: list[_Scanned] = []
        self._seen, self._step = 0, 1

    def add(
        self,
        scene: PreparedScene,
        classes: Int[np.ndarray, ' regions'],
        true_labels: Int[np.ndarray, ' points'],
        count: int,
    ) -> None:
        """Take in a scene.

        Args:
            scene: Points, regions and their graph.
            classes: The only class annotated in each region; -1: none, or several.
            true_labels: True class of each point, -1 = unknown.
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
            distance = annotated_distances(scene.cloud.xyz, scene.regions, true_labels, count)
            self._scenes.append(_Scanned(rows, ~level_regions(scene.graph, self._level), distance))
        self._seen += 1
        if len(self._scenes) > MOST_SCENES:
            self._scenes, self._step = self._scenes[::2], 2 * self._step

    def learn(self, lengths: Float[np.ndarray, ' classes'], scale: float | None) -> RegionKnowledge | None:
        """What was gathered; None where fewer than :data:`LEAST_EXAMPLES` regions were clicked.

        Args:
            lengths: See :func:`~rm3d_plugin.pseudo_labels.common.distance_prior.nearness`.
            scale: See there.
        """
        if sum(map(len, self._classes)) < LEAST_EXAMPLES:
            return None
        every = _joined([scene.rows for scene in self._scenes])
        usual = usual_of(strength_sums(every.ranges, every.strengths[:, 0], every.sizes))
        columns = every.columns(usual)
        large = every.sizes >= LEAST_POINTS
        scaling = scaling_of(columns[large] if large.any() else columns, _column_weights(columns.shape[1]))
        labels = np.concatenate(self._classes)
        chosen = evenly_chosen(labels, MOST_EXAMPLES)
        examples = _joined(self._examples).select(chosen).columns(usual)
        classes = fit_kernel_classes(examples, labels[chosen], scaling, LENGTH)
        standing = np.concatenate([scene.standing for scene in self._scenes])
        near = np.concatenate([nearness(scene.distance, lengths, scale) for scene in self._scenes])[standing]
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
