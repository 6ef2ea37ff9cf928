"""Where making labels meets learning from them, in detection."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float, Int
from mmengine.dist import all_gather_object

from rm3d_plugin.evaluation.functional import SceneTruth
from rm3d_plugin.labeling.cluster_knowledge import ClusterKnowledge
from rm3d_plugin.labeling.label_maker import LabelMaker, Log, Predictions, SceneLabels, Task
from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.labeling.round_summary import summarise_boxes, with_agreement, with_steps
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.pseudo_labels import (
    AnnotatedLabels,
    ObjectKnowledge,
    PointPrediction,
    RefreshResult,
    RoundContext,
    SceneInputs,
    TeacherRules,
    detection_rules,
    refresh_detection,
)
from rm3d_plugin.pseudo_labels.common.strategy import Strategy
from rm3d_plugin.pseudo_labels.detection.boxes import median_sizes, size_ranges
from rm3d_plugin.pseudo_labels.detection.instances import agreement, predicted_instances
from rm3d_plugin.pseudo_labels.detection.objects import most_boxes, score_limits
from rm3d_plugin.pseudo_labels.detection.refresh import find_candidates
from rm3d_plugin.pseudo_labels.detection.rules import DetectionRules
from rm3d_plugin.pseudo_labels.detection.teacher import (
    BoxLimits,
    box_limits,
    expected_from_whole,
    joined_shown,
    most_expected,
)
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import Boxes3D, LabelStatistics, PointCloud, Regions

RANKED_SCENES = 200  # of each process; their predictions are kept in memory while the best candidates are ranked
STEP = 'step_'  # before the names of columns in a ledger: candidates of each class that a step cost
AGREE = 'agree_'  # the same: how far classes, instances and boxes agree


@TASK_UTILS.register_module()
class DetectionLabelMaker(LabelMaker):
    """Labels of detection: annotated boxes, pseudo boxes and the points in them.

    Args:
        store: Folder of the label store.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.
        strategy: 'default', or 'paper': ``merge`` and boxes as printed; see
            :func:`~rm3d_plugin.pseudo_labels.detection.rules.detection_rules`, as the next four.
        merge: Fields of :class:`~rm3d_plugin.regions.MergeRules`.
        objects: Fields of :class:`~rm3d_plugin.pseudo_labels.ObjectRules`.
        self_training: Fields of :class:`~rm3d_plugin.pseudo_labels.SelfTrainingRules`, or None; ``holdout`` is of
            segmentation.
        teacher: Fields of :class:`~rm3d_plugin.pseudo_labels.TeacherRules`, or None: groups of regions become boxes.
        default_sizes: (C, 3) metres, for classes without an annotated box.
        cluster_descriptor: Config of a descriptor provider that tells what clusters look like beside their shapes,
            where predicted boxes ask that (``least_likeness``, ``source='clusters'``); None: shapes alone.
        geometry: Further arguments of :class:`~rm3d_plugin.labeling.prepared_scenes.PreparedScenes`: ``cache``,
            ``descriptor``, ``oversegmenter``, ``graph_neighbors``, ``max_gap``.

    Attributes:
        rules: How labels are made.
        scenes: Geometry by scene.
    """

    task: ClassVar[Task] = 'detection'

    def __init__(
        self,
        store: str | Path,
        source: Mapping[str, Any] | LabelSource,
        strategy: Strategy = 'default',
        merge: Mapping[str, Any] | None = None,
        objects: Mapping[str, Any] | None = None,
        self_training: Mapping[str, Any] | None = None,
        teacher: Mapping[str, Any] | None = None,
        default_sizes: Sequence[Sequence[float]] | None = None,
        cluster_descriptor: Mapping[str, Any] | None = None,
        **geometry: Any,
    ) -> None:
        super().__init__(store, source)
        self.rules = _as_asked(detection_rules(strategy, merge, objects, self_training, teacher))
        self.scenes = PreparedScenes(self._cloud, lambda scene_id: None, **geometry)
        self._default_sizes = None if default_sizes is None else np.asarray(default_sizes, dtype=np.float64)
        self._cluster_descriptor = cluster_descriptor
        self._limits: Float[np.ndarray, ' classes'] | None = None
        self._box_limits: BoxLimits | None = None
        self.forget()

    def _cloud(self, scene_id: str) -> PointCloud:
        return self.source.load_cloud(self.index_of[scene_id])

    def prepare(self, jobs: int = 1) -> str:
        """Fill the geometry cache."""
        return self.scenes.prepare(self.index_of, jobs)

    def forget(self) -> None:
        """Annotated labels, sizes and counts are read anew."""
        self._annotated: dict[str, AnnotatedLabels] = {}
        self._mean_sizes: Float[np.ndarray, 'classes 3'] | None = None
        self._size_ranges: Float[np.ndarray, 'classes 2 3'] | None = None
        self._class_counts: Int[np.ndarray, ' classes'] | None = None
        self._clusters: ClusterKnowledge | None = None

    # ------------------------------------------------------------------ annotated labels

    def annotated(self, scene_id: str) -> AnnotatedLabels:
        """Annotated labels of a scene."""
        if scene_id not in self._annotated:
            self._annotated[scene_id] = self.source.annotated_labels(self.index_of[scene_id])
        return self._annotated[scene_id]

    @property
    def mean_sizes(self) -> Float[np.ndarray, 'classes 3']:
        """Median sizes of the annotated boxes by class, metres; ``default_sizes`` (or NaN) for a class without any."""
        if self._mean_sizes is None:
            boxes = _joined([self.annotated(scene).boxes for scene in self.index_of])
            sizes = median_sizes(boxes.tensor, boxes.labels, len(self.source.classes))
            if self._default_sizes is not None:
                sizes = np.where(np.isfinite(sizes), sizes, self._default_sizes)
            self._mean_sizes = sizes
        return self._mean_sizes

    @property
    def size_ranges(self) -> Float[np.ndarray, 'classes 2 3']:
        """Least and greatest sizes of the annotated boxes by class, metres."""
        if self._size_ranges is None:
            boxes = _joined([self.annotated(scene).boxes for scene in self.index_of])
            self._size_ranges = size_ranges(boxes.tensor, boxes.labels, self.mean_sizes)
        return self._size_ranges

    @property
    def class_counts(self) -> Int[np.ndarray, ' classes']:
        """Annotated boxes of each class."""
        if self._class_counts is None:
            labels = _joined([self.annotated(scene).boxes for scene in self.index_of]).labels
            self._class_counts = np.bincount(labels, minlength=len(self.source.classes))
        return self._class_counts

    def statistics(self) -> LabelStatistics:
        """Counts and sizes of the annotated boxes, and whether network or looks judged the places in the labels."""
        sizes = self.mean_sizes if np.isfinite(self.mean_sizes).all() else None
        teacher, judged = self.rules.teacher, False
        if teacher is not None and teacher.ignore_unknown:
            judged = bool(self.store.current_round()) or self._looks_tell()
        return LabelStatistics(self.class_counts, sizes, judged)

    # ------------------------------------------------------------------ labels

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """Merge regions, find objects, complete the boxes."""
        result = self._result(number, scene_id, prediction)
        counts = {f'{STEP}{name}': lost for name, lost in result.steps.items()}
        counts |= {f'{AGREE}{name}': found for name, found in self._agreement(scene_id, prediction, result).items()}
        return SceneLabels(result.labels, result.merge.ledger.to_arrays() | counts)

    def _agreement(
        self, scene_id: str, said: PointPrediction | None, result: RefreshResult
    ) -> dict[str, Int[np.ndarray, ' classes']]:
        """Of classes, instances and boxes of a scene, see :func:`agreement`; empty where nobody says where to vote."""
        if said is None or said.centers is None:
            return {}
        least = self.rules.objects.min_points
        found = predicted_instances(said.probabilities, said.centers, self.mean_sizes, least)
        return agreement(self.scenes.get(scene_id).cloud.xyz, said.probabilities, found, result.labels.boxes)

    def look_ahead(self, number: int, predictions: Predictions) -> Predictions:
        """The first scenes of each process tell which scores are good in each class, where that is asked."""
        fractions, classes = self.rules.objects.top_fraction, len(self.mean_sizes)
        self._limits = self._box_limits = None
        if fractions is None and self.rules.teacher is None:
            return predictions
        rest = iter(predictions)
        first = list(islice(rest, RANKED_SCENES))
        if self.rules.teacher is not None:
            self._box_limits = self._limits_of_boxes(number, first, self.rules.teacher)
        elif fractions is not None:
            found = [self._result(number, scene, seen).candidates for scene, seen in first]
            everywhere = [boxes for part in all_gather_object(found) for boxes in part]
            ratio = len(self.index_of) / max(len(everywhere), 1)
            self._limits = score_limits(_joined(everywhere), classes, fractions, number, self._most(number) / ratio)
        return chain(first, rest)

    def _limits_of_boxes(
        self, number: int, first: Sequence[tuple[str, PointPrediction]], rules: TeacherRules
    ) -> BoxLimits:
        """What the scores of predicted boxes mean, from some scenes of every process."""
        own = [
            find_candidates(self._inputs(number, scene, seen), self.rules, self._knowledge(scene))
            for scene, seen in first
        ]
        found = [scene for part in all_gather_object(own) for scene in part]
        boxes, shown = _joined([scene.boxes for scene in found]), joined_shown([scene.shown for scene in found])
        ratio = len(self.index_of) / max(len(found), 1)
        most = self._most_expected(number, rules.growth)
        return box_limits(boxes, shown, len(self.mean_sizes), rules, ratio, self._expected(), most)

    def _result(self, number: int, scene_id: str, prediction: PointPrediction | None) -> RefreshResult:
        scene = self._inputs(number, scene_id, prediction)
        return refresh_detection(
            scene, RoundContext(number, self.rules, self.class_counts), self._knowledge(scene_id, number)
        )

    def _expected(self) -> Float[np.ndarray, ' classes'] | None:
        """Objects of each class without an annotated box, from completely labelled scenes; None: there are none."""
        whole = [self.annotated(scene) for scene in self.index_of if self.annotated(scene).complete]
        counts = [np.bincount(known.boxes.labels, minlength=len(self.mean_sizes)) for known in whole]
        return expected_from_whole(counts, len(self.index_of) - len(whole))

    def _most_expected(self, number: int, growth: float) -> Float[np.ndarray, ' classes'] | None:
        """So many times what the last round with predictions expected; None: there was none."""
        if number < 2:
            return None
        rows = self.store.summary(number - 1)['boxes'].values()
        if any('expected' not in row for row in rows):
            return None
        return most_expected([row['expected'] for row in rows], [row['pseudo'] for row in rows], growth)

    def _most(self, number: int) -> Float[np.ndarray, ' classes']:
        """See :func:`most_boxes`."""
        rounds = [self.store.summary(earlier)['boxes'].values() for earlier in range(1, number)]
        found = [[row['pseudo'] for row in boxes] for boxes in rounds]
        return most_boxes(found, self.class_counts, self.rules.objects.max_growth)

    def _inputs(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneInputs:
        previous = self.store.read(scene_id, number - 1) if number else None
        return SceneInputs(self.scenes.get(scene_id), self.annotated(scene_id), prediction, previous)

    def _knowledge(self, scene_id: str, number: int = 0) -> ObjectKnowledge:
        cloud = self.scenes.get(scene_id).cloud
        ground = segment_ground(cloud.xyz)
        limits = (self._limits, self._box_limits) if number else (None, None)
        clusters = self._cluster_knowledge().of(scene_id, ground) if self._uses_clusters else None
        return ObjectKnowledge(self.mean_sizes, ground.height, *limits, self.size_ranges, clusters)

    def _looks_tell(self) -> bool:
        """Whether looks are asked and known of every class."""
        teacher = self.rules.teacher
        return teacher is not None and teacher.least_likeness > 0 and self._cluster_knowledge().of_every_class

    @property
    def _uses_clusters(self) -> bool:
        teacher = self.rules.teacher
        return teacher is not None and (teacher.source == 'clusters' or teacher.least_likeness > 0)

    def _cluster_knowledge(self) -> ClusterKnowledge:
        if self._clusters is None:
            self._clusters = ClusterKnowledge(
                list(self.index_of), self.scenes, self.annotated, self.mean_sizes, self._cluster_descriptor
            )
        return self._clusters

    def check(self, number: int, log: Log) -> None:
        """Nothing is kept aside; the log tells where looks cannot be asked."""
        teacher = self.rules.teacher
        if number == 0 and teacher is not None and teacher.least_likeness > 0 and not self._looks_tell():
            log(
                'predicted_boxes.least_likeness: looks tell nothing of background here, since not every class has two '
                'annotated boxes with points'
            )

    def regions(self, scene_id: str) -> Regions | None:
        """The partition."""
        return self.scenes.get(scene_id).regions

    def evaluate(self, number: int) -> dict[str, Any]:
        """Coverage and precision of the points, and which pseudo boxes are correct."""
        scenes = [(self.store.read(scene, number), self._truth(index)) for scene, index in self.index_of.items()]
        summary = summarise_boxes(scenes, self.source.classes)
        expected = None if self._box_limits is None or not number else self._box_limits.expected
        total = self._totals(number)
        steps = {name[len(STEP) :]: lost for name, lost in total.items() if name.startswith(STEP)}
        agreed = {name[len(AGREE) :]: found for name, found in total.items() if name.startswith(AGREE)}
        return with_agreement(with_steps(summary, steps, expected), agreed)

    def _totals(self, number: int) -> dict[str, Int[np.ndarray, ' classes']]:
        """Columns of the ledgers that count something of each class, over all scenes."""
        total: dict[str, np.ndarray] = {}
        for scene in self.index_of:
            for name, counts in self.store.read_ledger(scene, number).items():
                if name.startswith((STEP, AGREE)):
                    total[name] = total.get(name, 0) + counts
        return total

    def _truth(self, index: int) -> SceneTruth | None:
        truth = self.source.truth(index)
        if truth is None or truth.semantic is None:
            return None
        cloud = self.source.load_cloud(index)
        ranges = None if cloud.sensor is None else np.linalg.norm(cloud.xyz - cloud.sensor, axis=1)
        return SceneTruth(truth.semantic, boxes=truth.boxes, ranges=ranges)


def _as_asked(rules: DetectionRules) -> DetectionRules:
    """Where the first labels stay nothing is ever predicted, so what belongs to predicted boxes is not asked."""
    if rules.teacher is None or rules.merge.rounds > 1:
        return rules
    return replace(rules, teacher=replace(rules.teacher, least_likeness=0.0))


def _joined(parts: Iterable[Boxes3D]) -> Boxes3D:
    boxes = [Boxes3D.empty(), *parts]
    columns = zip(*((part.tensor, part.labels, part.scores) for part in boxes), strict=True)
    return Boxes3D(*(np.concatenate(column) for column in columns))
