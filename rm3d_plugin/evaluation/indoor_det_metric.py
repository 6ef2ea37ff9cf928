"""Average precision and recall of boxes as indoor detection counts them, as an mmengine metric."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mmengine.logging import print_log

from rm3d_plugin.evaluation.functional.box_ap import BoxAp, box_ap
from rm3d_plugin.evaluation.point_fields import class_names, fields_of, format_columns, numpy_of, percent
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, share
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import Boxes3D, SceneError


@dataclass(frozen=True, eq=False)
class SceneBoxes:
    """Both sides of one scene; no tuple, as mmengine rebuilds tuples when it gathers results."""

    truth: Boxes3D
    found: Boxes3D


def boxes_of(fields: Any, names: Sequence[str], scene_id: str) -> Boxes3D:
    """The boxes, labels and scores that a sample has under these names.

    Raises:
        SceneError: They do not fit each other, or a number is not finite.
    """
    try:
        return Boxes3D(*(numpy_of(fields[name]) for name in names))
    except ValueError as error:
        raise SceneError(f'scene {scene_id}: {names[0]} cannot be used: {error}') from error


@METRICS.register_module()
class IndoorDetMetric(RecordedMetric):
    """AP and recall of each class at each overlap, in percent; see :func:`box_ap`.

    Reads of each sample ``pred_bboxes_3d``, ``pred_labels_3d``, ``pred_scores_3d``, ``gt_bboxes_3d`` and
    ``gt_labels_3d``, which the data set hands on with ``labels='truth'``. For boxes of any scans: boxes that turn
    overlap as they stand.

    Args:
        classes: Names of the class numbers; None: those of the data set.
        iou_thresholds: 3D overlaps above which a detection hits.
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        classes: Sequence[str] | None = None,
        iou_thresholds: Sequence[float] = (0.25, 0.5),
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.classes, self.iou_thresholds = classes, tuple(iou_thresholds)

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of the class numbers."""
        return class_names(self.classes, self.dataset_meta, 'IndoorDetMetric')

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Keep both sides of every scene of a batch."""
        found = ('pred_bboxes_3d', 'pred_labels_3d', 'pred_scores_3d')
        truth = ('gt_bboxes_3d', 'gt_labels_3d')
        for sample in data_samples:
            fields = fields_of(sample, (*found, *truth), 'IndoorDetMetric')
            scene_id = str(fields.get('scene_id', ''))
            self.results.append(SceneBoxes(boxes_of(fields, truth, scene_id), boxes_of(fields, found, scene_id)))

    def score(self, results: list[SceneBoxes]) -> list[ScoreRecord]:
        """The numbers over all scenes; the table goes to the log."""
        names = self.class_names
        truths, found = [scene.truth for scene in results], [scene.found for scene in results]
        tables = box_ap(truths, found, len(names), self.iou_thresholds)
        print_log('Average precision and recall of boxes (%)\n' + format_box_ap(tables, names), logger='current')
        return [record for table in tables for record in _records(table, names)]


def _records(table: BoxAp, names: Sequence[str]) -> list[ScoreRecord]:
    at = round(100 * table.iou)
    rows = [(name, table.ap[c], table.recall[c]) for c, name in enumerate(names) if np.isfinite(table.ap[c])]
    return [
        *(share(f'{name}_AP{at}', float(ap), 'objects', f'AP{at}', subject=name) for name, ap, _ in rows),
        *(share(f'{name}_recall{at}', float(part), 'objects', f'recall{at}', subject=name) for name, _, part in rows),
        share(f'mAP{at}', table.mean_ap, 'objects', f'AP{at}', headline=f'AP{at} of boxes'),
        share(f'mAR{at}', table.mean_recall, 'objects', f'recall{at}'),
    ]


def format_box_ap(tables: Sequence[BoxAp], names: Sequence[str]) -> str:
    """A line for each class and one for the means; AP and recall for each overlap."""
    lines = [
        (name, *(percent(float(values[c])) for table in tables for values in (table.ap, table.recall)))
        for c, name in enumerate(names)
    ]
    means = (percent(value) for table in tables for value in (table.mean_ap, table.mean_recall))
    head = [f'{what}{round(100 * table.iou)}' for table in tables for what in ('AP', 'recall')]
    return format_columns(('class', *head), [*lines, ('mean', *means)])
