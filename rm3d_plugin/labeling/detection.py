"""Where making labels meets learning from them, in detection."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from mmengine.dist import all_gather_object

from rm3d_plugin.evaluation.functional import SceneTruth
from rm3d_plugin.labeling.label_maker import LabelMaker, PointPrediction, SceneLabels
from rm3d_plugin.labeling.round_summary import summarise_boxes
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.pseudo_labels import AnnotatedLabels, ObjectRules, RefreshResult, refresh_detection
from rm3d_plugin.pseudo_labels.detection.boxes import size_priors
from rm3d_plugin.pseudo_labels.detection.objects import Evidence, score_limits
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import Boxes3D, LabelStatistics

JUDGED_SCENES = 200  # of each process; their predictions are kept in memory while a quota is found


@TASK_UTILS.register_module()
class DetectionLabelMaker(LabelMaker):
    """Labels of detection: annotated boxes, pseudo boxes and the points in them.

    Args:
        store: Folder of the label store.
        cache: Folder of prepared geometry.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.
        descriptor: Config of a descriptor provider.
        oversegmenter: Config of an over-segmenter.
        default_sizes: (C, 3) metres, for classes without an annotated box.
        rules: Fields of :class:`~rm3d_plugin.pseudo_labels.ObjectRules`.
        settings: Further arguments of :class:`LabelMaker`.
    """

    def __init__(
        self,
        store: str | Path,
        cache: str | Path,
        source: Mapping[str, Any] | LabelSource,
        descriptor: Mapping[str, Any],
        oversegmenter: Mapping[str, Any],
        default_sizes: Sequence[Sequence[float]] | None = None,
        rules: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(store, cache, source, descriptor, oversegmenter, **settings)
        self._default_sizes = None if default_sizes is None else np.asarray(default_sizes, dtype=np.float64)
        self._rules = ObjectRules(**(rules or {}))
        self._known: dict[str, AnnotatedLabels] = {}
        self._limits: Float[np.ndarray, ' classes'] | None = None

    def needs_geometry(self) -> bool:
        """True: every label but the annotated ones comes from regions."""
        return True

    def seeds(self, scene_id: str) -> Int[np.ndarray, ' seeds'] | None:
        """None: the points in an annotated box are no better starts than others."""
        return None

    @cached_property
    def priors(self) -> Float[np.ndarray, 'classes 3']:
        """Median sizes of the annotated boxes by class, metres; ``default_sizes`` (or NaN) for a class without any."""
        known = [self._annotated(scene).boxes for scene in self.index_of]
        boxes = np.concatenate([b.tensor for b in known]) if known else np.zeros((0, 7))
        labels = np.concatenate([b.labels for b in known]) if known else np.zeros(0, dtype=np.int64)
        sizes = size_priors(boxes, labels, len(self.source.classes))
        if self._default_sizes is not None:
            sizes = np.where(np.isfinite(sizes), sizes, self._default_sizes)
        return sizes

    @cached_property
    def class_counts(self) -> Int[np.ndarray, ' classes']:
        """Annotated boxes of each class."""
        labels = np.concatenate([self._annotated(scene).boxes.labels for scene in self.index_of])
        return np.bincount(labels, minlength=len(self.source.classes))

    def inform(self, model: Any) -> None:
        """Tell the model how many boxes of each class are annotated, and their sizes where all are known."""
        sizes = self.priors if np.isfinite(self.priors).all() else None
        model.set_label_statistics(LabelStatistics(self.class_counts, sizes))

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """Merge regions, find objects, complete the boxes."""
        result = self._result(number, scene_id, prediction, self._limits if number else None)
        return SceneLabels(result.labels, result.merge.ledger.to_arrays())

    def refresh_all(self, number: int, predictions: Iterable[tuple[str, PointPrediction]]) -> None:
        """With a quota, the first scenes of each process tell which score is among the best of its class."""
        rest = iter(predictions)
        first: list[tuple[str, PointPrediction]] = []
        self._limits = None
        if self._rules.quota is not None:
            first = list(islice(rest, JUDGED_SCENES))
            found = [self._result(number, scene, seen, None).candidates for scene, seen in first]
            everywhere = [boxes for part in all_gather_object(found) for boxes in part]
            self._limits = score_limits(_joined(everywhere), len(self.priors), self._rules.quota, number)
        super().refresh_all(number, chain(first, rest))

    def _result(
        self,
        number: int,
        scene_id: str,
        prediction: PointPrediction | None,
        limits: Float[np.ndarray, ' classes'] | None,
    ) -> RefreshResult:
        scene = self.prepared(scene_id)
        return refresh_detection(
            scene.cloud,
            scene.regions,
            scene.graph,
            self._annotated(scene_id),
            None if prediction is None else prediction.probabilities,
            None if prediction is None else prediction.centers,
            self.store.read(scene_id, number - 1) if number else None,
            self.strategy,
            number,
            self.priors,
            self.class_counts,
            segment_ground(scene.cloud.xyz).height,
            self._rules,
            Evidence(None if prediction is None else prediction.boxes, limits),
        )

    def summarise_round(self, number: int) -> dict[str, Any]:
        """Coverage and precision of the points, and which pseudo boxes are correct."""
        scenes = [(self.store.read(scene, number), self._truth(index)) for scene, index in self.index_of.items()]
        return summarise_boxes(scenes, self.source.classes)

    def _annotated(self, scene_id: str) -> AnnotatedLabels:
        if scene_id not in self._known:
            self._known[scene_id] = self.annotated(scene_id)
        return self._known[scene_id]

    def _truth(self, index: int) -> SceneTruth | None:
        truth = self.source.truth(index)
        if truth is None or truth.semantic is None:
            return None
        cloud = self.source.load_cloud(index)
        ranges = None if cloud.sensor is None else np.linalg.norm(cloud.xyz - cloud.sensor, axis=1)
        return SceneTruth(truth.semantic, boxes=truth.boxes, ranges=ranges)


def _joined(parts: Sequence[Boxes3D]) -> Boxes3D:
    boxes = [Boxes3D.empty(), *parts]
    columns = zip(*((part.tensor, part.labels, part.scores) for part in boxes), strict=True)
    return Boxes3D(*(np.concatenate(column) for column in columns))
