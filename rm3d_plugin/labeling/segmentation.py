"""Where making labels meets learning from them, in segmentation."""

import zlib
from collections.abc import Mapping
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.labeling.annotated import annotated_only, evaluate_points
from rm3d_plugin.labeling.knowledge import DatasetKnowledge
from rm3d_plugin.labeling.label_maker import LabelMaker, Log, Predictions, SceneLabels, Task
from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import (
    AnnotatedLabels,
    PointPrediction,
    RoundContext,
    SceneInputs,
    SceneKnowledge,
    refresh_segmentation,
    segmentation_rules,
)
from rm3d_plugin.pseudo_labels.common.strategy import Strategy
from rm3d_plugin.pseudo_labels.segmentation.holdout import (
    Holdout,
    HoldoutErrors,
    got_worse,
    holdout_errors,
    split_holdout,
    without_new_labels,
)
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import LabelStatistics, PointCloud, Regions

Seeds = Literal['none', 'annotated']
PRIOR = 'region_prior'  # under which the label store keeps it


@TASK_UTILS.register_module()
class SegmentationLabelMaker(LabelMaker):
    """Labels of segmentation: classes and instances of points, propagated over regions (METHOD 1).

    Scenes of which everything is annotated keep their labels as they are. Where ``self_training.holdout`` keeps
    annotated points aside, nothing but the check of a finished round knows them.

    Args:
        store: Folder of the label store.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.
        strategy: 'default', or 'paper': ``merge`` alone; see
            :func:`~rm3d_plugin.pseudo_labels.segmentation.rules.segmentation_rules`, as the next five.
        merge: Fields of :class:`~rm3d_plugin.regions.MergeRules`.
        propagation: Fields of :class:`~rm3d_plugin.pseudo_labels.PropagationRules`; None: off, as the next three.
        region_prior: Fields of :class:`~rm3d_plugin.pseudo_labels.RegionPriorRules`.
        ground: Fields of :class:`~rm3d_plugin.pseudo_labels.GroundRules`.
        self_training: Fields of :class:`~rm3d_plugin.pseudo_labels.SelfTrainingRules`.
        seeds: 'annotated': regions grow from the annotated points first, as the paper has it (METHOD 5). 'none': they
            depend on the geometry alone, so runs with other budgets or seeds share them.
        seed: Of the draw of the holdout.
        geometry: Further arguments of :class:`~rm3d_plugin.labeling.prepared_scenes.PreparedScenes`: ``cache``,
            ``descriptor``, ``oversegmenter``, ``graph_neighbors``, ``max_gap``.

    Attributes:
        rules: How labels are made.
        scenes: Geometry by scene.
        known: What all scenes together tell of each.
    """

    task: ClassVar[Task] = 'segmentation'

    def __init__(
        self,
        store: str | Path,
        source: Mapping[str, Any] | LabelSource,
        strategy: Strategy = 'default',
        merge: Mapping[str, Any] | None = None,
        propagation: Mapping[str, Any] | None = None,
        region_prior: Mapping[str, Any] | None = None,
        ground: Mapping[str, Any] | None = None,
        self_training: Mapping[str, Any] | None = None,
        seeds: Seeds = 'annotated',
        seed: int = 0,
        **geometry: Any,
    ) -> None:
        if seeds not in get_args(Seeds):
            raise ValueError(
                f'SegmentationLabelMaker.seeds: expected one of {", ".join(get_args(Seeds))}, got {seeds!r}'
            )
        super().__init__(store, source)
        self.rules = segmentation_rules(strategy, merge, propagation, region_prior, ground, self_training)
        self.scenes = PreparedScenes(self._cloud, self.seeds, **geometry)
        self._seeds, self._seed = seeds, seed
        self.forget()

    def _cloud(self, scene_id: str) -> PointCloud:
        return self.source.load_cloud(self.index_of[scene_id])

    def prepare(self, jobs: int = 1) -> str:
        """Fill the geometry cache."""
        return self.scenes.prepare(self.index_of, jobs)

    def forget(self) -> None:
        """Statistics, counts and regions that start from annotated points are made anew."""
        self.scenes.forget()
        scene_ids, classes = list(self.index_of), len(self.source.classes)
        self.known = DatasetKnowledge(scene_ids, self.scenes, self.annotated, self.rules, classes)
        self._class_counts: Int[np.ndarray, ' classes'] | None = None

    # ------------------------------------------------------------------ annotated labels

    def holdout(self, scene_id: str) -> Holdout:
        """Annotated labels of a scene in two parts: what is trained on, and what checks the rounds."""
        share = 0.0 if self.rules.self_training is None else self.rules.self_training.holdout
        rng = np.random.default_rng([self._seed, zlib.crc32(scene_id.encode())])
        return split_holdout(self.source.annotated_labels(self.index_of[scene_id]), share, rng)

    def annotated(self, scene_id: str) -> AnnotatedLabels:
        """Annotated labels of a scene, without the holdout."""
        return self.holdout(scene_id).annotated

    def seeds(self, scene_id: str) -> Int[np.ndarray, ' seeds'] | None:
        """The annotated points, where the over-segmentation shall start from them; not those of a complete scene."""
        if self._seeds == 'none':
            return None
        annotated = self.annotated(scene_id)
        return None if annotated.complete else np.flatnonzero(annotated.semantic >= 0)

    @property
    def class_counts(self) -> Int[np.ndarray, ' classes']:
        """Annotated points of each class, without the holdout."""
        if self._class_counts is None:
            counts = self.source.point_counts()
            if self.rules.self_training is not None and self.rules.self_training.holdout:
                for scene in self.index_of:
                    counts = counts - np.bincount(self.holdout(scene).classes, minlength=len(counts))
            self._class_counts = counts
        return self._class_counts

    def statistics(self) -> LabelStatistics:
        """How often each class is annotated."""
        return LabelStatistics(self.class_counts)

    # ------------------------------------------------------------------ labels

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """Merge regions and propagate what is known over them."""
        annotated = self.annotated(scene_id)
        if annotated.complete:
            return SceneLabels(annotated_only(annotated))
        previous = self.store.read(scene_id, number - 1) if number else None
        scene = SceneInputs(self.scenes.get(scene_id), annotated, prediction, previous)
        round = RoundContext(number, self.rules, self.class_counts, tuple(self.source.thing_classes))
        prior = self._prior(number, scene_id, scene)
        knowledge = SceneKnowledge(self.known.class_lengths(), prior, self.known.ground_labels(scene))
        result = refresh_segmentation(scene, round, knowledge)
        return SceneLabels(result.labels, result.merge.ledger.to_arrays())

    def _prior(self, number: int, scene_id: str, scene: SceneInputs) -> Float[np.ndarray, 'regions classes'] | None:
        """What the regions of a scene may be; the label store keeps it from round 0 on, until the budget grows."""
        rules = self.rules.region_prior
        if rules is None:
            return None
        kept = self.store.read_kept(PRIOR, scene_id) if number else None
        if kept is not None and np.array_equal(kept['class_counts'], self.class_counts):
            return kept['prior']
        prior = self.known.region_prior(scene, rules)
        self.store.keep(PRIOR, scene_id, {'prior': prior, 'class_counts': self.class_counts})
        return prior

    def look_ahead(self, number: int, predictions: Predictions) -> Predictions:
        """Each scene stands for itself."""
        return predictions

    def evaluate(self, number: int) -> dict[str, Any]:
        """Coverage and precision of each class, and how far the centres of instances are off."""
        return evaluate_points(self, number)

    def regions(self, scene_id: str) -> Regions | None:
        """The partition; None for a scene of which everything is annotated."""
        return None if self.annotated(scene_id).complete else self.scenes.get(scene_id).regions

    # ------------------------------------------------------------------ the holdout

    def check(self, number: int, log: Log) -> None:
        """Drop a round's new labels of the classes that contradict more holdout points than before."""
        rules = self.rules.self_training
        if not number or rules is None or not rules.holdout:
            return
        new, old = self._errors(number), self._errors(number - 1)
        worse = got_worse(new, old, rules.holdout_margin)
        if not worse.any():
            return
        for scene in self.index_of:
            labels, previous = self.store.read(scene, number), self.store.read(scene, number - 1)
            self.store.write(number, scene, without_new_labels(labels, previous, worse))
        names = ', '.join(
            f'{name} ({new.wrong[c]} of {new.compared[c]} wrong, {old.wrong[c]} of {old.compared[c]} before)'
            for c, name in enumerate(self.source.classes)
            if worse[c]
        )
        log(f'labels of round {number}: the holdout contradicts {names}; new labels of these are dropped')

    def _errors(self, number: int) -> HoldoutErrors:
        count = len(self.source.classes)
        nothing = HoldoutErrors(np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64))
        parts = (holdout_errors(self.store.read(s, number).semantic, self.holdout(s), count) for s in self.index_of)
        return reduce(add, parts, nothing)
