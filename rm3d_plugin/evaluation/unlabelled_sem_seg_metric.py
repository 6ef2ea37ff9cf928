"""Mean intersection over union on the points that training was not told of: how well labels spread within a scan."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.evaluation.functional.semantic_iou import confusion_counts
from rm3d_plugin.evaluation.point_fields import class_names, fields_of, numpy_of, point_truth, predicted_classes
from rm3d_plugin.evaluation.sem_seg_metric import SemSegMetric
from rm3d_plugin.registry import METRICS
from rm3d_plugin.storage.label_store import LabelStore
from rm3d_plugin.structures import UNLABELLED


@METRICS.register_module()
class UnlabelledSemSegMetric(SemSegMetric):
    """:class:`SemSegMetric` without the revealed points, for runs that are scored on the scenes they learn from.

    Args:
        label_store: Folder of the run's label store, which tells the revealed points of each scene.
        settings: Arguments of :class:`SemSegMetric`.
    """

    def __init__(self, label_store: str | Path, **settings: Any) -> None:
        super().__init__(**settings)
        self.label_store = LabelStore(label_store)

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
            revealed = self.label_store.read(fields['scene_id']).point_is_true
            hidden = revealed if truth.original is None else revealed[truth.original]
            semantic = np.where(hidden, UNLABELLED, truth.semantic)
            self.results.append(confusion_counts(truth.spread(rows, -1), semantic, count, self.ignored))
