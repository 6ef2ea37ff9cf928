"""Waymo's AP and APH as an mmengine metric."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from mmengine.logging import print_log

from rm3d_plugin.datasets.waymo_format import TYPES, WaymoBoxes
from rm3d_plugin.evaluation.functional.waymo_ap import (
    CUTOFFS,
    LEVELS,
    RANGES,
    WAYMO_IOU,
    WaymoEntry,
    WaymoTruth,
    of_range,
    waymo_ap,
)
from rm3d_plugin.evaluation.indoor_det_metric import boxes_of
from rm3d_plugin.evaluation.point_fields import class_names, fields_of, format_columns, percent
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, Table, share
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import Boxes3D

Measure = Literal['AP', 'APH']
MEASURES: tuple[Measure, ...] = ('AP', 'APH')
_FOUND = ('pred_bboxes_3d', 'pred_labels_3d', 'pred_scores_3d')


@dataclass(frozen=True, eq=False)
class WaymoFrameBoxes:
    """Both sides of one frame; no tuple, as mmengine rebuilds tuples when it gathers results."""

    annotation: WaymoBoxes
    found: Boxes3D


@METRICS.register_module()
class WaymoMetric(RecordedMetric):
    """AP and APH of each class at levels 1 and 2, in percent, their means, and by distance; see :func:`waymo_ap`.

    Reads of each sample ``pred_bboxes_3d``, ``pred_labels_3d``, ``pred_scores_3d`` (vehicle frame) and metainfo
    ``annotation``, which the data set hands on with ``labels='truth'``: every box of the frame, whatever range the
    network sees.

    Args:
        classes: Names of the predicted class numbers, of Vehicle, Pedestrian and Cyclist; None: those of the data set.
        iou_thresholds: 3D overlap from which a detection hits, for each class.
        cutoffs: Scores at which the curve is sampled.
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        classes: Sequence[str] | None = None,
        iou_thresholds: Mapping[str, float] = WAYMO_IOU,
        cutoffs: Sequence[float] = CUTOFFS,
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.classes, self.iou_thresholds, self.cutoffs = classes, dict(iou_thresholds), tuple(cutoffs)

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of the predicted class numbers."""
        return class_names(self.classes, self.dataset_meta, 'WaymoMetric')

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Keep both sides of every frame of a batch."""
        for sample in data_samples:
            fields = fields_of(sample, (*_FOUND, 'annotation'), 'WaymoMetric')
            found = boxes_of(fields, _FOUND, str(fields.get('scene_id', '')))
            self.results.append(WaymoFrameBoxes(WaymoBoxes(*fields['annotation']), found))

    def score(self, results: list[WaymoFrameBoxes]) -> list[ScoreRecord]:
        """The numbers over all frames; the table goes to the log."""
        names = self.class_names
        truths, found = [truth_of(frame.annotation, names) for frame in results], [frame.found for frame in results]
        table = waymo_ap(truths, found, names, self.iou_thresholds, self.cutoffs)
        print_log('Waymo average precision (%)\n' + format_waymo(table), logger='current')
        records = [_record(entry, what) for entry in table for what in MEASURES]
        records += [_mean(table, level, what) for level in LEVELS for what in MEASURES]
        for name, limits in RANGES.items():
            part = waymo_ap(*of_range(truths, found, limits), names, self.iou_thresholds, self.cutoffs)
            records += [_record(entry, what, name) for entry in part for what in MEASURES]
        return records


def _record(entry: WaymoEntry, what: Measure, distance: str = '') -> ScoreRecord:
    value = entry.ap if what == 'AP' else entry.aph
    key = f'{entry.class_name}_L{entry.level}_{what}' + f' {distance}' * bool(distance)
    table: Table = 'ranges' if distance else 'objects'
    return share(key, value, table, f'L{entry.level} {what}', subject=entry.class_name, variant=distance)


def truth_of(annotation: WaymoBoxes, names: Sequence[str]) -> WaymoTruth:
    """The boxes that count: of the classes, with a lidar point."""
    numbers = {TYPES[name]: number for number, name in enumerate(names)}
    labels = np.array([numbers.get(kind, -1) for kind in annotation.types.tolist()], dtype=np.int64)
    kept = (labels >= 0) & (annotation.points > 0)
    return WaymoTruth(annotation.boxes[kept], labels[kept], annotation.level[kept])


def _mean(table: Sequence[WaymoEntry], level: int, what: Measure) -> ScoreRecord:
    values = [entry.ap if what == 'AP' else entry.aph for entry in table if entry.level == level and entry.num_truth]
    headline = 'L2 mAPH' if (level, what) == (2, 'APH') else ''
    mean = float(np.mean(values)) if values else 0.0
    return share(f'L{level}_m{what}', mean, 'objects', f'L{level} {what}', headline=headline)


def format_waymo(table: Sequence[WaymoEntry]) -> str:
    """A line for each class and level."""
    lines = [(e.class_name, str(e.level), percent(e.ap), percent(e.aph), str(e.num_truth)) for e in table]
    return format_columns(('class', 'level', 'AP', 'APH', 'true'), lines)
