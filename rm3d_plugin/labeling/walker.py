"""Labels of segmentation that spread as a random walker would carry them, over each scan."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Int

from rm3d_plugin.labeling.annotated import annotated_only, evaluate_points
from rm3d_plugin.labeling.label_maker import LabelMaker, Log, Predictions, SceneLabels, Task
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import AnnotatedLabels, PointPrediction
from rm3d_plugin.pseudo_labels.propagation import PreparedCloud, WalkerRules, prepare_cloud, propagate_prepared
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.storage.recent import RecentItems
from rm3d_plugin.structures import UNLABELLED, Boxes3D, LabelStatistics, PseudoLabels, Regions


def _size(scene: PreparedCloud) -> int:
    return scene.features.nbytes + scene.graph.weights.data.nbytes + scene.graph.weights.indices.nbytes


@TASK_UTILS.register_module()
class WalkerLabelMaker(LabelMaker):
    task: ClassVar[Task] = 'segmentation'

    def __init__(
        self,
        store: str | Path,
        source: Mapping[str, Any] | LabelSource,
        accept: float = 0.6,
        top: float = 0.0,
        seed: int = 0,
        **unused,
    ) -> None:
        super().__init__(store, source)
        self.rules = WalkerRules(seed=seed)
        self.accept = accept
        self.top = top
        self._scenes: RecentItems[PreparedCloud] = RecentItems(1024, _size)

    def scene(self, scene_id: str) -> PreparedCloud:
        make = lambda: prepare_cloud(self.source.load_cloud(self.index_of[scene_id]))
        return self._scenes.get_or_make(scene_id, make)

    def prepare(self, jobs: int = 1) -> str:
        return 'nothing'

    def forget(self) -> None:
        pass

    def annotated(self, scene_id: str) -> AnnotatedLabels:
        return self.source.annotated_labels(self.index_of[scene_id])

    def statistics(self) -> LabelStatistics:
        return LabelStatistics(self.source.point_counts())

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        annotated = self.annotated(scene_id)
        if annotated.complete:
            return SceneLabels(annotated_only(annotated))
        found = propagate_prepared(self.scene(scene_id), annotated.semantic, len(self.source.classes), self.rules)
        known = annotated.semantic >= 0
        limit = self.accept
        if self.top:
            limit = min(limit, np.quantile(found.confidence, 1 - self.top))
        sure = known | (found.confidence >= limit)
        return SceneLabels(PseudoLabels(
            semantic=np.where(sure, found.semantic, UNLABELLED),
            instance=annotated.instance,
            point_is_annotated=known,
            confidence=np.where(sure, found.confidence, 0.0).astype(np.float32),
            boxes=Boxes3D.empty(),
            box_is_annotated=np.zeros(0, dtype=bool),
        ))

    def look_ahead(self, number: int, predictions: Predictions) -> Predictions:
        return predictions

    def check(self, number: int, log: Log) -> None:
        pass

    def evaluate(self, number: int) -> dict[str, Any]:
        return evaluate_points(self, number)

    def regions(self, scene_id: str) -> Regions | None:
        return None
