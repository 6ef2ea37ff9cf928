"""KITTI results as records and as a table for people."""

import math
from collections.abc import Iterable
from typing import Literal

from rm3d_plugin.evaluation.functional.kitti_ap import DIFFICULTIES, Difficulty, KittiAp, Metric
from rm3d_plugin.evaluation.point_fields import format_columns
from rm3d_plugin.evaluation.records import ScoreRecord

Recall = Literal['R40', 'R11']

RECALLS: tuple[Recall, ...] = ('R40', 'R11')
HEADLINE = ('3d', 'moderate', 'R40')
INTERPOLATED = ', interpolated'


def kitti_records(result: KittiAp, variant: str = '') -> list[ScoreRecord]:
    """Percent: ``Car_3d_moderate_R40@0.70`` of classes, and the means ``mAP_3d_moderate_R40``.

    Cells without truth are left out; a mean is over the classes that have truth, and None where none has. What was
    interpolated is called so.

    Args:
        result: The table.
        variant: Word for the thresholds where there are two sets of them; ends the names of the means.
    """
    records = []
    for entry in result.entries:
        for recall, value in (('R40', entry.r40), ('R11', entry.r11)) if entry.num_truth else ():
            key = f'{entry.class_name}_{entry.metric}_{entry.difficulty}_{recall}@{entry.iou:.2f}'
            measure, at = f'{entry.metric} AP {recall}', f'@ {entry.iou:.2f}' + INTERPOLATED * entry.interpolated
            records.append(ScoreRecord(key, value, 'boxes', measure, entry.class_name, at, entry.difficulty))
    for metric in dict.fromkeys(entry.metric for entry in result.entries):
        for level in DIFFICULTIES:
            for recall in RECALLS:
                records.append(_mean(result, metric, level, recall, variant))
    return records


def _mean(result: KittiAp, metric: Metric, level: Difficulty, recall: Recall, variant: str) -> ScoreRecord:
    words = f'3D AP, {variant or "official"} IoU' if (metric, level, recall) == HEADLINE else ''
    mean = result.mean(metric, level, 'r40' if recall == 'R40' else 'r11')
    interpolated = any(entry.interpolated for entry in result.counted(metric, level))
    return ScoreRecord(
        key=f'mAP_{metric}_{level}_{recall}' + (f'_{variant}' if variant else ''),
        value=None if math.isnan(mean) else mean,
        table='boxes',
        measure=f'{metric} AP {recall}',
        variant=(variant + INTERPOLATED * interpolated).removeprefix(', '),
        level=level,
        headline=words,
    )


def format_table(records: Iterable[ScoreRecord]) -> str:
    """The table as text: a line for each class, measure and threshold, a column for each difficulty; percent."""
    rows: dict[tuple[str, str], dict[str, float]] = {}
    for record in records:
        name = (record.subject or 'mean', f'{record.measure} {record.variant}'.strip())
        rows.setdefault(name, {})[record.level] = record.number
    lines = [(*name, *(_cell(found.get(level, math.nan)) for level in DIFFICULTIES)) for name, found in rows.items()]
    return format_columns(('class', 'AP', *DIFFICULTIES), lines)


def _cell(value: float) -> str:
    return '-' if math.isnan(value) else f'{value:.2f}'
