"""From the flat numbers of metrics to the tables and curves of a report."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from rm3d_plugin.visualization import Chart, ResultRow, ScoreTable, Series

_KITTI = re.compile(
    r'(?P<name>\w+?)_(?P<metric>3d|bev)_(?P<level>easy|moderate|hard)_R40(@(?P<iou>[\d.]+)|(?P<loose>_loose)?)'
)
# Column of a class and the mean's key, as the metrics of segmentation name them.
CLASS_COLUMNS = {
    'IoU': 'mIoU',
    'AP': 'AP',
    'AP50': 'AP50',
    'AP25': 'AP25',
    'precision': 'mPrec',
    'recall': 'mRec',
}
OVERALL = {
    'mAcc': 'mean recall of the classes',
    'accuracy': 'points that are right',
    'mCov': 'mean coverage of instances',
    'mWCov': 'mean coverage of instances, weighted by size',
}
HEADLINES = {
    'mAP_3d_moderate_R40_loose': '3D AP, loose IoU',
    'mAP_3d_moderate_R40': '3D AP, official IoU',
    'mIoU': 'mIoU',
    'AP50': 'AP50 of instances',
}  # 3D AP: means, moderate
CURVES = ('mIoU', 'mAcc', 'AP', 'AP50', 'AP25', 'mPrec', 'mRec', 'mCov', 'mWCov')
NAN = float('nan')


def result_rows(scores: Mapping[str, float]) -> list[ResultRow]:
    """Rows (class, metric, easy, moderate, hard) of the 3D and bird's-eye AP (R40) among flat scores, percent."""
    table: dict[tuple[str, str], dict[str, float]] = {}
    for key, value in scores.items():
        match = _KITTI.fullmatch(key)
        if match:
            iou = f' @ {match["iou"]}' if match['iou'] else (' loose' if match['loose'] else '')
            name = 'mean' if match['name'] == 'mAP' else match['name']
            table.setdefault((name, f'{match["metric"]} AP R40{iou}'), {})[match['level']] = value
    return [
        ResultRow(name, metric, row.get('easy', NAN), row.get('moderate', NAN), row.get('hard', NAN))
        for (name, metric), row in table.items()
    ]


def point_table(scores: Mapping[str, float | None]) -> ScoreTable | None:
    """IoU, AP, precision and recall of each class among flat scores, percent, then the means; None without any.

    A prefix of a metric (``val/IoU_chair``) is left aside. Whole-scene numbers (:data:`OVERALL`) follow as rows of
    their own, in the first column.
    """
    flat = {key.rpartition('/')[2]: NAN if value is None else float(value) for key, value in scores.items()}
    cells: dict[str, dict[str, float]] = {}
    for key, value in flat.items():
        column, separator, name = key.partition('_')
        if separator and column in CLASS_COLUMNS:
            cells.setdefault(name, {})[column] = value
    means = {column: flat[key] for column, key in CLASS_COLUMNS.items() if key in flat}
    columns = [c for c in CLASS_COLUMNS if c in means or any(c in row for row in cells.values())]
    if not columns:
        return None
    rows = [(name, *(row.get(c, NAN) for c in columns)) for name, row in cells.items()]
    rows.append(('mean', *(means.get(c, NAN) for c in columns)))
    rows += [(words, flat[key], *[NAN] * (len(columns) - 1)) for key, words in OVERALL.items() if key in flat]
    return ScoreTable('Percent, on validation scenes', ('Class', *columns), rows)


def result_table(scores: Mapping[str, float]) -> str:
    """All class scores as plain text, one line a class; a dash where there was nothing to find."""
    points = point_table(scores)
    if points is not None:
        return _text(points, 44)
    lines = [f'{"class":<12}{"metric":<22}{"easy":>8}{"moderate":>10}{"hard":>8}']
    for row in result_rows(scores):
        easy, moderate, hard = ('-' if math.isnan(v) else f'{v:.2f}' for v in (row.easy, row.moderate, row.hard))
        lines.append(f'{row.class_name:<12}{row.metric:<22}{easy:>8}{moderate:>10}{hard:>8}')
    return '\n'.join(lines)


def _text(table: ScoreTable, widest: int) -> str:
    width = min(widest, max(len(str(row[0])) for row in table.rows)) + 2
    lines = [f'{table.head[0].lower():<{width}}' + ''.join(f'{name:>10}' for name in table.head[1:])]
    for name, *values in table.rows:
        lines.append(f'{name:<{width}}' + ''.join(f'{"-" if math.isnan(v) else f"{v:.2f}":>10}' for v in values))
    return '\n'.join(lines)


def headlines(scores: Mapping[str, float | None]) -> dict[str, str]:
    """The numbers that stand on top of the page."""
    flat = {key.rpartition('/')[2]: value for key, value in scores.items()}
    found = {name: flat.get(key) for key, name in HEADLINES.items()}
    return {name: f'{value:.1f} %' for name, value in found.items() if value is not None}


def loss_chart(losses: Mapping[str, Mapping[str, float]]) -> Chart | None:
    """Mean losses of every epoch; None before the first."""
    epochs = sorted(losses, key=int)
    if not epochs:
        return None
    x = [int(epoch) for epoch in epochs]
    names = [name for name in losses[epochs[0]] if name.startswith('loss')]
    lines = {name: Series(x, [losses[epoch].get(name, NAN) for epoch in epochs]) for name in names}
    return Chart('Training losses', 'epoch', 'mean loss', lines)


def score_chart(validation: Mapping[str, Mapping[str, float]]) -> Chart | None:
    """Moderate 3D AP, or the means of segmentation, of every validation; None where there are fewer than two."""
    epochs = sorted(validation, key=int)
    if len(epochs) < 2:
        return None
    x = [int(epoch) for epoch in epochs]
    names = [key for key in validation[epochs[0]] if '_3d_moderate_R40' in key]
    if names:
        lines = {name: Series(x, [validation[epoch][name] for epoch in epochs]) for name in names}
        return Chart('Moderate 3D AP (R40)', 'epoch', '%', lines, y_low=0.0)
    keys = [key for name in CURVES for key in validation[epochs[0]] if key.rpartition('/')[2] == name]
    lines = {key: Series(x, [_number(validation[epoch].get(key)) for epoch in epochs]) for key in keys}
    return Chart('Validation scores', 'epoch', '%', lines, y_low=0.0) if lines else None


def label_charts(rounds: Sequence[Mapping[str, Any]]) -> list[Chart]:
    """Coverage and precision of a segmentation run's pseudo labels by round, and how far instance centres are off."""
    known = [entry for entry in rounds if 'mean_precision' in entry]
    if len(known) < 2:
        return []
    x = [int(entry['round']) for entry in known]

    def line(key: str, scale: float) -> Series:
        return Series(x, [scale * _number(entry.get(key)) for entry in known])

    shares = {
        'coverage': line('coverage', 100),
        'precision': line('precision', 100),
        'mean precision of the classes': line('mean_precision', 100),
    }
    charts = [Chart('Pseudo labels', 'round', '%', shares, y_low=0.0)]
    if any(entry.get('offset_error') is not None for entry in known):
        offsets = {'all classes': line('offset_error', 1)}
        charts.append(Chart('Offset error of pseudo instances', 'round', 'metres', offsets, y_low=0.0))
    return charts


def _number(value: float | None) -> float:
    return NAN if value is None else float(value)
