"""Self-training in rounds: pseudo labels are what the network says, where a rule accepts it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Int

from rm3d_plugin.labeling.accept import Accept
from rm3d_plugin.labeling.annotated import annotated_only, evaluate_points
from rm3d_plugin.labeling.label_maker import LabelMaker, Log, Predictions, SceneLabels, Task
from rm3d_plugin.labeling.prepared_scenes import PreparedScenes
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.ops.segment import segment_majority
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.regions.prepare import PreparedScene
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
        spread: Whether an annotated point labels its whole region, in every round; where classes meet in a region, the
            most frequent one does.
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
        spread: bool = False,
        **geometry: Any,
    ) -> None:
        super().__init__(store, source)
        self.accept: Accept = TASK_UTILS.build(accept) if isinstance(accept, Mapping) else accept
        self.reads_features = self.accept.reads_features or self.source.reads_features
        self._permanent, self._spread = permanent, spread
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
        if annotated.complete:
            return SceneLabels(annotated)
        if self._spread:
            wide = spread_over_regions(annotated.semantic, self._scene(scene_id).regions)
            annotated = with_pseudo_labels(annotated, wide, np.ones(len(wide)))
        if prediction is None:
            return SceneLabels(annotated)
        found = self.accept(prediction, annotated.semantic, lambda: self._scene(scene_id))
        labels = with_pseudo_labels(annotated, found.semantic, found.confidence)
        if self._permanent:
            before = self.store.read(scene_id, number - 1)
            labels = with_pseudo_labels(before, labels.semantic, labels.confidence)
        return SceneLabels(labels)

    def _scene(self, scene_id: str) -> PreparedScene:
        if self._scenes is None:
            raise ValueError(
                f'PredictedLabelMaker: {type(self.accept).__name__} asks for regions; give cache, descriptor and '
                'oversegmenter'
            )
        return self._scenes.get(scene_id)

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


def spread_over_regions(semantic: Int[np.ndarray, ' points'], regions: Regions) -> Int[np.ndarray, ' points']:
    """Each point gets the most frequent class among the labelled points of its region; -1: there is none."""
    classes = segment_majority(semantic, regions.labels, len(regions))
    return np.where(regions.labels >= 0, np.append(classes, UNLABELLED)[regions.labels], UNLABELLED)


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
