"""Self-training in rounds: pseudo labels are what the network says, where a rule accepts it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rm3d_plugin.labeling.accept import Accept
from rm3d_plugin.labeling.annotated import annotated_only, evaluate_points
from rm3d_plugin.labeling.label_maker import LabelMaker, Log, Predictions, SceneLabels, Task
from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import UNLABELLED, Boxes3D, LabelStatistics, PointCloud, PseudoLabels, Regions


@TASK_UTILS.register_module()
class PredictedLabelMaker(LabelMaker):
    """The annotated points first, then, round by round, the answers of the network that a rule accepts.

    Args:
        store: Folder of the label store.
        source: A :class:`~rm3d_plugin.labeling.sources.LabelSource` or its config.
        accept: An :class:`~rm3d_plugin.labeling.accept.Accept` or its config.
        permanent: Whether what was accepted once stays; False: each round is chosen anew.
        geometry: Arguments of :class:`~rm3d_plugin.labeling.prepared_scenes.PreparedScenes`, for rules that ask for
            regions.
    """

    task: ClassVar[Task] = 'segmentation'

    def __init__(
        self,
        store: str | Path,
        source: Mapping[str, Any] | LabelSource,
        accept: Mapping[str, Any] | Accept,
        permanent: bool = False,
        **geometry: Any,
    ) -> None:
        super().__init__(store, source)
        self.accept: Accept = TASK_UTILS.build(accept) if isinstance(accept, Mapping) else accept
        self._permanent = permanent
        self._scenes = PreparedScenes(self._cloud, lambda scene_id: None, **geometry) if geometry else None

    def _cloud(self, scene_id: str) -> PointCloud:
        return self.source.load_cloud(self.index_of[scene_id])

    def prepare(self, jobs: int = 1) -> str:
        """Fill the geometry cache, where there are regions."""
        if self._scenes is None:
            return 'answers of the network are taken point by point, which needs no geometry'
        return self._scenes.prepare(self.index_of, jobs)

    def statistics(self) -> LabelStatistics:
        """Annotated points of each class."""
        return LabelStatistics(self.source.point_counts())

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """The annotated labels, and beside them what the rule accepts."""
        annotated = annotated_only(self.source.annotated_labels(self.index_of[scene_id]))
        if prediction is None or annotated.complete:
            return SceneLabels(annotated)
        found = self.accept(prediction.probabilities, annotated.semantic, lambda: self._regions(scene_id))
        labels = with_pseudo_labels(annotated, found.semantic, found.confidence)
        if self._permanent:
            before = self.store.read(scene_id, number - 1)
            labels = with_pseudo_labels(before, labels.semantic, labels.confidence)
        return SceneLabels(labels)

    def _regions(self, scene_id: str) -> Regions:
        if self._scenes is None:
            raise ValueError(
                f'PredictedLabelMaker: {type(self.accept).__name__} asks for regions; give cache, descriptor and '
                'oversegmenter'
            )
        return self._scenes.get(scene_id).regions

    def look_ahead(self, number: int, predictions: Predictions) -> Predictions:
        """Each scene stands for itself."""
        return predictions

    def check(self, number: int, log: Log) -> None:
        """What was accepted stays."""

    def evaluate(self, number: int) -> dict[str, Any]:
        """Coverage and precision of each class."""
        return evaluate_points(self, number)

    def regions(self, scene_id: str) -> Regions | None:
        """The regions, where the rule may ask for them."""
        return None if self._scenes is None else self._scenes.get(scene_id).regions

    def forget(self) -> None:
        """Nothing was derived."""


def with_pseudo_labels(given: PseudoLabels, semantic: np.ndarray, confidence: np.ndarray) -> PseudoLabels:
    """The given labels, and where they are silent others, of no instance.

    Args:
        given: They always win.
        semantic: (N,) class, -1 = none.
        confidence: (N,) in [0, 1].
    """
    free = (given.semantic == UNLABELLED) & (semantic != UNLABELLED)
    return PseudoLabels(
        semantic=np.where(free, semantic, given.semantic),
        instance=given.instance,
        point_is_annotated=given.point_is_annotated,
        confidence=np.where(free, confidence, given.confidence).astype(np.float32),
        boxes=Boxes3D.empty(),
        box_is_annotated=np.zeros(0, dtype=bool),
        complete=given.complete,
    )
