"""What the labelled regions of all scenes have in common; one pass over the scenes, since reading them takes time."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.region_prior.classifier import RegionCollector, RegionKnowledge
from rm3d_plugin.pseudo_labels.region_prior.features import LEAST_POINTS, RegionExamples, collect_examples, region_looks
from rm3d_plugin.pseudo_labels.segmentation.propagation import SeededRegions, seeded_regions, usual_lengths
from rm3d_plugin.regions import MergeStrategy
from rm3d_plugin.regions.features import region_lengths
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import UNLABELLED


class RegionSurvey(NamedTuple):
    """Regions of all scenes.

    Attributes:
        lengths: (C,) metres, how long the regions of each class's true labels usually are; NaN: unknown.
        looks: What labelled regions look like; None: there are none, or nobody asked.
    """

    lengths: Float[np.ndarray, ' classes']
    looks: RegionExamples | RegionKnowledge | None


def survey_regions(
    scenes: Iterable[tuple[PreparedScene, Int[np.ndarray, ' points']]], count: int, strategy: MergeStrategy
) -> RegionSurvey:
    """Read every scene once.

    Args:
        scenes: Geometry and true class (-1 = unknown) of the points of each.
        count: Number of classes.
        strategy: Says whether looks are asked for, and of which kind; where too few regions are labelled to teach a
            classifier, single examples speak. Regions longer than ``spread_extent`` usual lengths of their class are
            none of those.
    """
    seeds: list[tuple[np.ndarray, np.ndarray]] = []
    own: list[np.ndarray] = []  # length of each example
    kernel = strategy.region_prior and strategy.prior_looks == 'kernel'
    collector = RegionCollector(strategy.heading, strategy.level_regions)

    def labelled() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        for scene, true_labels in scenes:
            seeded, lengths = seeded_regions(scene.regions.labels, true_labels), region_lengths(scene.graph)
            seeds.append((seeded.classes, lengths[seeded.regions]))
            classes = _only_class(seeded, len(lengths))
            if kernel:
                collector.add(scene, classes, true_labels, count)
            if strategy.region_prior:
                own.append(lengths[(classes >= 0) & (scene.graph.sizes >= LEAST_POINTS)])
                yield region_looks(scene.cloud, scene.regions, scene.graph), classes, scene.graph.sizes

    examples = collect_examples(labelled())
    classes, lengths = (np.concatenate([np.zeros(0), *part]) for part in zip(*seeds, strict=True))
    usual = usual_lengths(classes, lengths, count)
    learnt = collector.learn(usual, strategy.prior_scale)
    if learnt is not None:
        return RegionSurvey(usual, learnt)
    if examples is None or strategy.spread_extent is None:
        return RegionSurvey(usual, examples)
    fit = ~(np.concatenate(own) > usual[examples.classes] * strategy.spread_extent)
    left = examples._replace(looks=examples.looks[fit], classes=examples.classes[fit])
    return RegionSurvey(usual, left if fit.any() else None)


def _only_class(seeded: SeededRegions, regions: int) -> Int[np.ndarray, ' regions']:
    """Class of each region; -1: it has none, or several."""
    classes = np.full(regions, UNLABELLED, dtype=np.int64)
    once = np.bincount(seeded.regions, minlength=regions)[seeded.regions] == 1
    classes[seeded.regions[once]] = seeded.classes[once]
    return classes
