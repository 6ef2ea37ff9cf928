"""Labels that are annotated and no other: the weak and the full reference."""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from rm3d_plugin.evaluation.functional import SceneTruth
from rm3d_plugin.labeling.label_maker import LabelMaker, Log, Predictions, SceneLabels, Task
from rm3d_plugin.labeling.round_summary import summarise_points
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import AnnotatedLabels, PointPrediction
from rm3d_plugin.registry import TASK_UTILS
from rm3d_plugin.structures import Boxes3D, LabelStatistics, PseudoLabels, Regions


@TASK_UTILS.register_module()
class AnnotatedLabelMaker(LabelMaker):
    """Training sees the annotated points of a segmentation data set alone, the same in every round; no region is made.

    Args: as :class:`LabelMaker`.
    """

    task: ClassVar[Task] = 'segmentation'

    def prepare(self, jobs: int = 1) -> str:
        """Nothing to do."""
        return 'training sees the annotated labels alone, which need no geometry'

    def statistics(self) -> LabelStatistics:
        """Annotated points of each class."""
        return LabelStatistics(self.source.point_counts())

    def make_labels(self, number: int, scene_id: str, prediction: PointPrediction | None) -> SceneLabels:
        """The annotated labels."""
        return SceneLabels(annotated_only(self.source.annotated_labels(self.index_of[scene_id])))

    def look_ahead(self, number: int, predictions: Predictions) -> Predictions:
        """Nothing is needed."""
        return predictions

    def check(self, number: int, log: Log) -> None:
        """Annotated labels stay."""

    def evaluate(self, number: int) -> dict[str, Any]:
        """Coverage of the classes."""
        return evaluate_points(self, number)

    def regions(self, scene_id: str) -> Regions | None:
        """None."""
        return None

    def forget(self) -> None:
        """Nothing was derived."""


def evaluate_points(label_maker: LabelMaker, number: int) -> dict[str, Any]:
    """Coverage and precision of each class, and how far the centres of instances are off; see :func:`summarise_points`.

    Args:
        label_maker: Whose labels.
        number: The round.
    """
    return summarise_points(_with_truth(label_maker, number), label_maker.source.classes)


def _with_truth(label_maker: LabelMaker, number: int) -> Iterator[tuple[PseudoLabels, SceneTruth | None]]:
    source = label_maker.source
    for scene, index in label_maker.index_of.items():
        yield label_maker.store.read(scene, number), scene_truth(source, index)


def scene_truth(source: LabelSource, index: int) -> SceneTruth | None:
    """The truth of the points of a scene, for reports; None where nobody knows it."""
    truth = source.truth(index)
    if truth is None or truth.semantic is None:
        return None
    return SceneTruth(truth.semantic, truth.instance, source.load_cloud(index).xyz)


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
