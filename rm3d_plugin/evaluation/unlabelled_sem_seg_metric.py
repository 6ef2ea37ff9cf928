"""Mean intersection over union on the points that training was not told of: how well labels spread within a scan."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.evaluation.functional.semantic_iou import confusion_counts
from rm3d_plugin.evaluation.point_fields import (
    class_names,
    fields_of,
    ignored_values,
    numpy_of,
    point_truth,
    predicted_classes,
)
from rm3d_plugin.evaluation.sem_seg_metric import SemSegMetric
from rm3d_plugin.registry import METRICS
from rm3d_plugin.storage.label_store import LabelStore
from rm3d_plugin.structures import UNLABELLED


@METRICS.register_module()
class UnlabelledSemSegMetric(SemSegMetric):
    """:class:`SemSegMetric` without the annotated points, for runs that are scored on the scenes they learn from.

    Args:
        label_store: Folder of the run's label store, which tells the annotated points of each scene.
        keep_labels: True scores what the run says of its own scene: points with a label in the current round have that
            label; what the others are the labels say where they name a likeliest class, else the network.
        settings: Arguments of :class:`SemSegMetric`.
    """

    def __init__(self, label_store: str | Path, keep_labels: bool = False, **settings: Any) -> None:
        super().__init__(**settings)
        self.label_store = LabelStore(label_store)
        self.keep_labels = keep_labels

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Count the unlabelled points of every scene of a batch.

        Raises:
            LabelStoreError: A scene is none that the run learns from.
        """
        name = type(self).__name__
        count = len(class_names(self.classes, self.dataset_meta, name))
        for sample in data_samples:
            fields = fields_of(sample, ['pred_point_probs', 'scene_id'], name)
            rows = predicted_classes(numpy_of(fields['pred_point_probs']))
            truth = point_truth(fields, len(rows), name)
            labels = self.label_store.read(fields['scene_id'])
            whole = slice(None) if truth.original is None else truth.original
            semantic = np.where(labels.point_is_annotated[whole], UNLABELLED, truth.semantic)
            said = truth.scatter(rows, -1)
            if self.keep_labels:
                for known in (labels.likeliest, labels.semantic):
                    said = said if known is None else np.where(known[whole] >= 0, known[whole], said)
            ignored = ignored_values(self.ignored, self.dataset_meta)
            self.results.append(confusion_counts(said, semantic, count, ignored))
