"""Data set statistics: what the annotated regions of all scenes have in common, from one pass over them."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.annotated import RegionClassPairs, annotated_region_classes, usual_lengths
from rm3d_plugin.pseudo_labels.region_prior.classifier import RegionCollector, RegionKnowledge
from rm3d_plugin.pseudo_labels.region_prior.features import (
    LEAST_POINTS,
    RegionExamples,
    collect_examples,
    prior_features,
)
from rm3d_plugin.pseudo_labels.region_prior.rules import RegionPriorRules
from rm3d_plugin.regions.features import region_lengths
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import UNLABELLED


class RegionStatistics(NamedTuple):
    """Regions of all scenes.

    Attributes:
        lengths: (C,) metres, how long the regions of each class's annotated labels usually are; NaN: unknown.
        known: What annotated regions teach of others; None: there are none, or nobody asked.
    """

    lengths: Float[np.ndarray, ' classes']
    known: RegionExamples | RegionKnowledge | None


def region_statistics(
    scenes: Iterable[tuple[PreparedScene, Int[np.ndarray, ' points']]],
    count: int,
    rules: RegionPriorRules | None,
    max_extent: float | None = None,
    min_upright: float | None = None,
) -> RegionStatistics:
    """Read every scene once.

    Args:
        scenes: Geometry and annotated class (-1 = none) of the points of each.
        count: Number of classes.
        rules: Say which classifier is asked for; where too few regions are annotated to teach one, single examples
            speak. None: none is.
        max_extent: Regions longer than so many usual lengths of their class are no examples; None: all are.
        min_upright: Regions so upright are ground, see :class:`RegionCollector`; None: none is.
    """
    seeds: list[tuple[np.ndarray, np.ndarray]] = []
    own: list[np.ndarray] = []  # length of each example
    kernel = rules is not None and rules.classifier == 'kernel'
    collector = RegionCollector(rules is not None and rules.heading, min_upright)

    def annotated_rows() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        for scene, annotated in scenes:
            pairs, lengths = annotated_region_classes(scene.regions.labels, annotated), region_lengths(scene.graph)
            seeds.append((pairs.classes, lengths[pairs.regions]))
            classes = _only_class(pairs, len(lengths))
            if kernel:
                collector.add(scene, classes, annotated, count)
            if rules is not None:
                own.append(lengths[(classes >= 0) & (scene.graph.sizes >= LEAST_POINTS)])
                yield prior_features(scene.cloud, scene.regions, scene.graph), classes, scene.graph.sizes

    examples = collect_examples(annotated_rows())
    classes = np.concatenate([np.zeros(0, dtype=np.int64), *(own for own, _ in seeds)])
    lengths = np.concatenate([np.zeros(0), *(length for _, length in seeds)])
    usual = usual_lengths(classes, lengths, count)
    learnt = collector.learn(usual, None if rules is None else rules.distance_scale)
    if learnt is not None:
        return RegionStatistics(usual, learnt)
    if examples is None or max_extent is None:
        return RegionStatistics(usual, examples)
    fit = ~(np.concatenate(own) > usual[examples.classes] * max_extent)
    left = examples._replace(features=examples.features[fit], classes=examples.classes[fit])
    return RegionStatistics(usual, left if fit.any() else None)


def _only_class(pairs: RegionClassPairs, regions: int) -> Int[np.ndarray, ' regions']:
    """Class of each region; -1: it has none, or several."""
    classes = np.full(regions, UNLABELLED, dtype=np.int64)
    once = np.bincount(pairs.regions, minlength=regions)[pairs.regions] == 1
    classes[pairs.regions[once]] = pairs.classes[once]
    return classes
