"""S3DIS's instance precision, recall and coverage as an mmengine metric."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from mmengine.logging import print_log

from rm3d_plugin.evaluation.functional.instance_ap import instance_ap
from rm3d_plugin.evaluation.functional.instance_overlap import InstanceOverlap
from rm3d_plugin.evaluation.functional.instance_precision_recall import (
    InstancePrecisionRecall,
    instance_precision_recall,
)
from rm3d_plugin.evaluation.instance_seg_metric import overlap_of_sample
from rm3d_plugin.evaluation.point_fields import chosen_classes, class_names, format_columns, percent
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, share
from rm3d_plugin.registry import METRICS


@METRICS.register_module()
class S3DISInstanceMetric(RecordedMetric):
    """mPrec, mRec, mCov, mWCov and AP50, in percent; see :func:`instance_precision_recall`.

    Reads what :class:`InstanceSegMetric` reads. AP50 counts instances of any size.

    Args:
        classes: Names of the class numbers; None: those of the data set.
        instance_classes: Evaluated classes, by number or name; None: the data set's ``thing_classes``, or all.
        overlap: Overlap that a hit must exceed.
        asis_compat: Count as the script of ASIS: from the overlap on, several hits on one true instance allowed.
        min_score: Found instances under this score are left out of precision, recall and coverage.
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        classes: Sequence[str] | None = None,
        instance_classes: Sequence[int | str] | None = None,
        overlap: float = 0.5,
        asis_compat: bool = False,
        min_score: float = 0.0,
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.classes, self.instance_classes = classes, instance_classes
        self.overlap, self.asis_compat, self.min_score = overlap, asis_compat, min_score

    @property
    def evaluated(self) -> tuple[int, ...]:
        """Evaluated class numbers."""
        names = class_names(self.classes, self.dataset_meta, 'S3DISInstanceMetric')
        return chosen_classes(self.instance_classes, names, self.dataset_meta, 'S3DISInstanceMetric')

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Keep sizes and overlaps of every scene of a batch, not its masks."""
        evaluated = self.evaluated
        self.results += [overlap_of_sample(sample, evaluated, 'S3DISInstanceMetric') for sample in data_samples]

    def score(self, results: list[InstanceOverlap]) -> list[ScoreRecord]:
        """The numbers over all scenes; the table goes to the log."""
        names = class_names(self.classes, self.dataset_meta, 'S3DISInstanceMetric')
        sure = [scene.select(scene.scores >= self.min_score) for scene in results]
        scores = instance_precision_recall(sure, self.evaluated, self.overlap, self.asis_compat)
        ap = instance_ap(results, self.evaluated, min_points=0, overlaps=(0.5,))
        title = 'Precision, recall and coverage of instances (%)'
        print_log(f'{title}\n{format_precision_recall(scores, ap.ap50, names)}', logger='current')
        return [
            *(
                share(f'{measure}_{names[label]}', float(values[column]), 'instances', measure, subject=names[label])
                for column, label in enumerate(scores.classes)
                if scores.truths[column]
                for measure, values in (('precision', scores.precision), ('recall', scores.recall))
            ),
            share('mPrec', scores.mean_precision, 'instances', 'precision'),
            share('mRec', scores.mean_recall, 'instances', 'recall'),
            share('mCov', scores.mean_coverage, 'instances', 'mean coverage of instances'),
            share('mWCov', scores.mean_weighted_coverage, 'instances', 'mean coverage of instances, weighted by size'),
            share('AP50', ap.mean_ap50, 'instances', 'AP50', headline='AP50 of instances'),
        ]


def format_precision_recall(scores: InstancePrecisionRecall, ap50: np.ndarray, names: Sequence[str]) -> str:
    """A line for each class and one for the means."""
    columns = (scores.precision, scores.recall, scores.coverage, scores.weighted_coverage, ap50)
    lines = [
        (names[label], *(percent(column[i]) for column in columns), str(scores.truths[i]), str(scores.found[i]))
        for i, label in enumerate(scores.classes)
    ]
    means = (scores.mean_precision, scores.mean_recall, scores.mean_coverage, scores.mean_weighted_coverage)
    known = ap50[~np.isnan(ap50)]
    last = percent(float(known.mean()) if len(known) else 0.0)
    total = (str(int(scores.truths.sum())), str(int(scores.found.sum())))
    head = ('class', 'precision', 'recall', 'coverage', 'weighted', 'AP50', 'true', 'found')
    return format_columns(head, [*lines, ('mean', *map(percent, means), last, *total)])
