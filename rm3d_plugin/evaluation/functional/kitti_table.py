"""KITTI results as flat names for logs, and back as a table for people."""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rm3d_plugin.evaluation.functional.kitti_ap import DIFFICULTIES, KittiAp

_CELL = re.compile(
    r'^(?:.*/)?(?P<name>.+)_(?P<metric>bbox|aos|bev|3d)_(?P<level>easy|moderate|hard)_(?P<recall>R\d+@.+)$'
)
_MEAN = re.compile(r'^(?:.*/)?mAP_(?P<metric>bbox|aos|bev|3d)_(?P<level>easy|moderate|hard)_(?P<recall>R\d+(?:_.+)?)$')


class TableRow(NamedTuple):
    """One line of the table; percent, NaN where there was nothing to find."""

    class_name: str
    metric: str
    easy: float
    moderate: float
    hard: float


def flat_metrics(result: KittiAp, suffix: str = '') -> dict[str, float]:
    """Named numbers in percent: ``Car_3d_moderate_R40@0.70`` and the means ``mAP_3d_moderate_R40``.

    Cells without truth are left out; a mean is over the classes that have truth, and 0 where none has.

    Args:
        result: The table.
        suffix: Appended to the names of the means, to tell apart two sets of thresholds.
    """
    named: dict[str, float] = {}
    for entry in result.entries:
        if entry.num_truth:
            stem = f'{entry.class_name}_{entry.metric}_{entry.difficulty}'
            named[f'{stem}_R40@{entry.iou:.2f}'] = entry.r40
            named[f'{stem}_R11@{entry.iou:.2f}'] = entry.r11
    for metric in dict.fromkeys(entry.metric for entry in result.entries):
        for difficulty in DIFFICULTIES:
            named[f'mAP_{metric}_{difficulty}_R40{suffix}'] = result.mean(metric, difficulty, 'r40')
            named[f'mAP_{metric}_{difficulty}_R11{suffix}'] = result.mean(metric, difficulty, 'r11')
    return named


def table_rows(metrics: Mapping[str, float]) -> list[TableRow]:
    """Gather the names of :func:`flat_metrics` into lines, with or without a prefix; other names are passed over."""
    rows: dict[tuple[str, str], dict[str, float]] = {}
    for key, value in metrics.items():
        match = _MEAN.match(key) or _CELL.match(key)
        if match:
            name = match.groupdict().get('name') or 'mean'
            what = f'{match["metric"]} {match["recall"].replace("@", " @ ").replace("_", " ")}'
            rows.setdefault((name, what), {})[match['level']] = float(value)
    return [TableRow(name, what, *(found.get(d, np.nan) for d in DIFFICULTIES)) for (name, what), found in rows.items()]


def format_table(metrics: Mapping[str, float]) -> str:
    """The table as text: a line for each class, metric and threshold, a column for each difficulty; percent."""
    head = ('class', 'AP', *DIFFICULTIES)
    lines: list[Sequence[str]] = [head]
    for row in table_rows(metrics):
        lines.append((row.class_name, row.metric, *('-' if np.isnan(v) else f'{v:.2f}' for v in row[2:])))
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    text = [
        '  '.join(
            cell.ljust(w) if i < 2 else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    ]
    rule = '  '.join('-' * w for w in widths)
    return '\n'.join([text[0], rule, *text[1:]])
