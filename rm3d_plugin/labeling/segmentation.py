"""Where making labels meets learning from them, in segmentation."""

import zlib
from collections.abc import Iterator, Mapping
from functools import cached_property, reduce
from operator import add
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int
from tqdm import tqdm

from rm3d_plugin.evaluation.functional import SceneTruth
from rm3d_plugin.labeling.label_maker import LabelMaker, Log, PointPrediction, SceneLabels
from rm3d_plugin.labeling.round_summary import summarise_points
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import AnnotatedLabels, refresh_points
from rm3d_plugin.pseudo_labels.common.groups import point_values
from rm3d_plugin.pseudo_labels.ground.classifier import GroundKnowledge, LevelScene, survey_ground
from rm3d_plugin.pseudo_labels.ground.labels import LevelLabels, level_regions
from rm3d_plugin.pseudo_labels.region_prior.prior import region_prior
from rm3d_plugin.pseudo_labels.region_prior.statistics import RegionSurvey, survey_regions
from rm3d_plugin.pseudo_labels.segmentation.holdout import (
    Holdout,
    HoldoutErrors,
    got_worse,
    holdout_errors,
    split_holdout,
    without_new_labels,
)
from rm3d_plugin.regions import MergeLedger
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import UNLABELLED, Boxes3D, LabelStatistics, PseudoLabels

Seeds = Literal['none', 'annotated']


@TASK_UTILS.register_module()
class SegmentationLabelMaker(LabelMaker):
    """Labels of segmentation: classes and instances of points, spread over regions (METHOD 1).

    Scenes of which everything is annotated keep their labels as they are. Where ``strategy.holdout`` keeps annotated
    points aside, nothing but the check of a finished round knows them.

    Args:
        store: Folder of the label store.
        cache: Folder of prepared geometry.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.
        descriptor: Config of a descriptor provider.
        oversegmenter: Config of an over-segmenter.
        seeds: 'annotated': regions grow from the annotated points first, as the paper has it (METHOD 5). 'none': they
            depend on the geometry alone, so runs with other budgets or seeds share them.
        spread: False: training sees the annotated points alone (the weak baseline), no region is made and no point kept
            aside.
        seed: Of the draw of the points kept aside.
        settings: Further arguments of :class:`LabelMaker`.
    """

    def __init__(
        self,
        store: str | Path,
        cache: str | Path,
        source: Mapping[str, Any] | LabelSource,
        descriptor: Mapping[str, Any],
        oversegmenter: Mapping[str, Any],
        seeds: Seeds = 'annotated',
        spread: bool = True,
        seed: int = 0,
        **settings: Any,
    ) -> None:
        if seeds not in get_args(Seeds):
            raise ValueError(
                f'SegmentationLabelMaker.seeds: expected one of {", ".join(get_args(Seeds))}, got {seeds!r}'
            )
        super().__init__(store, cache, source, descriptor, oversegmenter, **settings)
        self.spread = spread
        self._seeds = seeds
        self._seed = seed

    def holdout(self, scene_id: str) -> Holdout:
        """Annotated labels of a scene in two parts: what is trained on, and what checks the rounds."""
        share = self.strategy.holdout if self.spread else 0.0
        rng = np.random.default_rng([self._seed, zlib.crc32(scene_id.encode())])
        return split_holdout(super().annotated(scene_id), share, rng)

    def annotated(self, scene_id: str) -> AnnotatedLabels:
        """Annotated labels of a scene, without the points that are kept aside."""
        return self.holdout(scene_id).annotated

    def needs_geometry(self) -> bool:
        """Whether labels spread over regions."""
        return self.spread

    def seeds(self, scene_id: str) -> Int[np.ndarray, ' seeds'] | None:
        """The annotated points, where the over-segmentation shall start from them; not those of a complete scene."""
        if self._seeds == 'none':
            return None
        annotated = self.annotated(scene_id)
        return None if annotated.complete else np.flatnonzero(annotated.semantic >= 0)

    @cached_property
    def class_counts(self) -> Int[np.ndarray, ' classes']:
        """Annotated points of each class, without those kept aside."""
        counts = self.source.point_counts()
        if self.strategy.holdout and self.spread:
            for scene in self.index_of:
                counts = counts - np.bincount(self.holdout(scene).classes, minlength=len(counts))
        return counts

    @cached_property
    def survey(self) -> RegionSurvey:
        """What the labelled regions of all scenes have in common."""
        scenes = ((self.prepared(scene), self.annotated(scene).semantic) for scene in self.index_of)
        return survey_regions(scenes, len(self.source.classes), self.strategy)

    def _prior(
        self, number: int, scene_id: str, scene: PreparedScene, annotated: AnnotatedLabels
    ) -> Float[np.ndarray, 'regions classes'] | None:
        """What the regions of a scene may be, where the strategy asks for it; the first round's ledger keeps it."""
        if not self.strategy.region_prior:
            return None
        if number:
            return MergeLedger.from_arrays(self.store.read_ledger(scene_id, 0)).known['probabilities']
        return region_prior(scene, annotated.semantic, self.survey.lengths, self.survey.looks, self.strategy)

    @cached_property
    def ground(self) -> GroundKnowledge | None:
        """What level ground looks like, where the strategy asks for it and enough is annotated."""
        if self.strategy.level_regions is None or not self.strategy.level_looks:
            return None
        return survey_ground(self._level_scenes, self.strategy.heading)

    def _level_scenes(self) -> Iterator[LevelScene]:
        for scene_id in tqdm(self.index_of, desc='what level ground looks like', leave=False):
            scene = self.prepared(scene_id)
            yield scene.cloud, self._level_points(scene), self.annotated(scene_id).semantic

    def _level_points(self, scene: PreparedScene) -> Bool[np.ndarray, ' points']:
        return point_values(level_regions(scene.graph, self.strategy.level_regions), scene.regions.labels, False)

    def _ground_labels(
        self, scene: PreparedScene, annotated: AnnotatedLabels, previous: PseudoLabels | None
    ) -> LevelLabels | None:
        """What the level points of a scene are by their looks; what the first round found stays."""
        if self.ground is None:
            return None
        level = self._level_points(scene)
        if previous is None:
            return self.ground.labels(scene.cloud, level, annotated.semantic, len(self.source.classes))
        return LevelLabels(np.where(level, previous.semantic, UNLABELLED), np.where(level, previous.confidence, 0.0))

    def inform(self, model: Any) -> None:
        """Tell the model how often each class is annotated."""
        model.set_label_statistics(LabelStatistics(self.class_counts))

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """Merge regions and spread what is known over them."""
        annotated = self.annotated(scene_id)
        if annotated.complete or not self.spread:
            return SceneLabels(annotated_only(annotated), None)
        scene = self.prepared(scene_id)
        previous = self.store.read(scene_id, number - 1) if number else None
        result = refresh_points(
            scene.cloud,
            scene.regions,
            scene.graph,
            annotated,
            None if prediction is None else prediction.probabilities,
            None if prediction is None else prediction.centers,
            previous,
            self.strategy,
            number,
            self.class_counts,
            tuple(self.source.thing_classes),
            None if self.strategy.spread_extent is None else self.survey.lengths,
            self._prior(number, scene_id, scene, annotated),
            self._ground_labels(scene, annotated, previous),
        )
        return SceneLabels(result.labels, result.merge.ledger.to_arrays())

    def finish(self, number: int, log: Log = print) -> None:
        """Take back what the points kept aside contradict, then close the round."""
        if number and self.strategy.holdout and self.spread:
            self._roll_back(number, log)
        super().finish(number, log)

    def _roll_back(self, number: int, log: Log) -> None:
        """Drop a round's new labels of the classes that contradict more kept-aside points than before."""
        new, old = self._errors(number), self._errors(number - 1)
        worse = got_worse(new, old, self.strategy.holdout_margin)
        if not worse.any():
            return
        for scene in self.index_of:
            labels, previous = self.store.read(scene, number), self.store.read(scene, number - 1)
            self.store.write(number, scene, without_new_labels(labels, previous, worse))
        names = ', '.join(
            f'{name} ({new.wrong[c]} of {new.judged[c]} wrong, {old.wrong[c]} of {old.judged[c]} before)'
            for c, name in enumerate(self.source.classes)
            if worse[c]
        )
        log(f'labels of round {number}: the points kept aside contradict {names}; new labels of these are dropped')

    def _errors(self, number: int) -> HoldoutErrors:
        count = len(self.source.classes)
        nothing = HoldoutErrors(np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64))
        parts = (holdout_errors(self.store.read(s, number).semantic, self.holdout(s), count) for s in self.index_of)
        return reduce(add, parts, nothing)

    def summarise_round(self, number: int) -> dict[str, Any]:
        """Coverage and precision of each class, and how far the centres of instances are off."""
        return summarise_points(self._judged(number), self.source.classes)

    def _judged(self, number: int) -> Iterator[tuple[PseudoLabels, SceneTruth | None]]:
        for scene, index in self.index_of.items():
            truth = self.source.truth(index)
            known = None
            if truth is not None and truth.semantic is not None:
                known = SceneTruth(truth.semantic, truth.instance, self.source.load_cloud(index).xyz)
            yield self.store.read(scene, number), known


def annotated_only(annotated: AnnotatedLabels) -> PseudoLabels:
    """The annotated labels and no other."""
    known = annotated.semantic >= 0
    return PseudoLabels(
        semantic=annotated.semantic,
        instance=annotated.instance,
        point_is_annotated=known,
        confidence=known.astype(np.float32),
        boxes=Boxes3D.empty(),
        box_is_annotated=np.zeros(0, dtype=bool),
        complete=annotated.complete,
    )
