"""Mean intersection over union of point classes as an mmengine metric."""

from collections.abc import Sequence
from logging import WARNING
from typing import Any, Literal, get_args

import numpy as np
from mmengine.logging import print_log

from rm3d_plugin.evaluation.functional.semantic_iou import (
    IGNORED,
    Absent,
    AccuracyOver,
    SemanticScores,
    confusion_counts,
    semantic_scores,
)
from rm3d_plugin.evaluation.point_fields import (
    class_names,
    fields_of,
    format_columns,
    ignored_values,
    percent,
    point_truth,
    semantic_rows,
)
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, share
from rm3d_plugin.registry import METRICS

Labels = Literal['truth', 'store']
AGREEMENT = 'agreement with its own pseudo labels, not accuracy'


@METRICS.register_module()
class SemSegMetric(RecordedMetric):
    """Classes of points, in percent; see :func:`semantic_iou`.

    Reads of each sample ``pred_point_probs`` (n, C; further columns, such as background, count as no class) or
    ``pred_pts_semantic_mask`` (n,), and the truth ``pts_semantic_mask`` (n,) or that of the whole scene, see
    :func:`~rm3d_plugin.evaluation.point_fields.point_truth`; points that were not predicted are then wrong. Samples of
    mmdetection3d are read, too: ``pred_pts_seg`` against ``eval_ann_info``.

    Args:
        classes: Names of the class numbers; None: those of the data set.
        ignored: True values that do not count, besides ``ignore_index`` of the data set's metainfo.
        absent: 'skip' or 'zero' for a class that is predicted, but has no truth.
        accuracy_over: 'known', or 'predicted' as SemanticKITTI's program.
        labels: What ``pts_semantic_mask`` holds, as the data set has it: 'truth', or 'store': pseudo labels of the run
            itself. Against these nothing is scored; the one number is the share of labelled points on which the
            network agrees with them.
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        classes: Sequence[str] | None = None,
        ignored: Sequence[int] = IGNORED,
        absent: Absent = 'skip',
        accuracy_over: AccuracyOver = 'known',
        labels: Labels = 'truth',
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.classes, self.ignored = classes, tuple(ignored)
        self.absent: Absent = absent
        self.accuracy_over: AccuracyOver = accuracy_over
        if labels not in get_args(Labels):
            raise ValueError(f'SemSegMetric.labels: expected one of {", ".join(get_args(Labels))}, got {labels!r}')
        self.labels: Labels = labels

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Count every scene of a batch."""
        count = len(class_names(self.classes, self.dataset_meta, 'SemSegMetric'))
        for sample in data_samples:
            fields = fields_of(sample, [], 'SemSegMetric')
            rows = semantic_rows(fields, 'SemSegMetric')
            truth = point_truth(fields, len(rows), 'SemSegMetric')
            ignored = ignored_values(self.ignored, self.dataset_meta)
            self.results.append(confusion_counts(truth.scatter(rows, -1), truth.semantic, count, ignored))

    def score(self, results: list[np.ndarray]) -> list[ScoreRecord]:
        """The numbers over all scenes; the table goes to the log."""
        names = class_names(self.classes, self.dataset_meta, 'SemSegMetric')
        zero = np.zeros((len(names), len(names) + 1), dtype=np.int64)
        scores = semantic_scores(sum(results, zero), self.absent, self.accuracy_over)
        if self.labels == 'store':
            print_log(f'The network: {percent(scores.accuracy)} % {AGREEMENT}', logger='current')
            return [share('agreement_not_accuracy', scores.accuracy, 'agreement', AGREEMENT)]
        if not scores.points.any():
            print_log('SemSegMetric: no point has a true class, so there is no score', logger='current', level=WARNING)
            return []
        print_log('Classes of points (%)\n' + format_scores(scores, names), logger='current')
        each = zip(names, scores.iou, strict=True)
        return [
            *(share(f'IoU_{name}', float(iou), 'points', 'IoU', subject=name) for name, iou in each),
            share('mIoU', scores.mean_iou, 'points', 'IoU', headline='mIoU'),
            share('mAcc', scores.mean_accuracy, 'points', 'mean recall of the classes'),
            share('accuracy', scores.accuracy, 'points', 'correct points'),
        ]


def format_scores(scores: SemanticScores, names: Sequence[str]) -> str:
    """A line for each class and one for the means."""
    columns = zip(names, scores.iou, scores.recall, scores.precision, scores.points, strict=True)
    lines = [(name, percent(i), percent(r), percent(p), str(n)) for name, i, r, p, n in columns]
    mean = ('mean', percent(scores.mean_iou), percent(scores.mean_accuracy), '', str(int(scores.points.sum())))
    correct = ('correct points', percent(scores.accuracy), '', '', '')
    return format_columns(('class', 'IoU', 'recall', 'precision', 'points'), [*lines, mean, correct])
