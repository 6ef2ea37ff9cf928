"""From the records of metrics to the tables and curves of a report."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rm3d_plugin.evaluation.kitti_table import format_table
from rm3d_plugin.evaluation.records import ScoreRecord
from rm3d_plugin.structures.label_estimate import estimate_text, has_estimate
from rm3d_plugin.visualization import Chart, ResultRow, ScoreTable, Series

BOX_MEASURES = ('3d AP R40', 'bev AP R40')  # the others stand in the log and in metrics.json
CLASS_TABLES = ('points', 'instances', 'segments', 'objects')
NAN = float('nan')


def result_rows(records: Sequence[ScoreRecord]) -> list[ResultRow]:
    """Rows (class, metric, easy, moderate, hard) of the 3D and bird's-eye AP (R40), percent."""
    table: dict[tuple[str, str], dict[str, float]] = {}
    for record in records:
        if record.table == 'boxes' and record.measure in BOX_MEASURES:
            name = (record.subject or 'mean', f'{record.measure} {record.variant}'.strip())
            table.setdefault(name, {})[record.level] = record.number
    return [
        ResultRow(name, measure, row.get('easy', NAN), row.get('moderate', NAN), row.get('hard', NAN))
        for (name, measure), row in table.items()
    ]


def point_table(records: Sequence[ScoreRecord]) -> ScoreTable | None:
    """IoU, AP, precision and recall of each class, percent, then the means; None without any.

    A measure that no class has (accuracy, say) follows in a row of its own, in the first column.
    """
    chosen = [record for record in records if record.table in CLASS_TABLES]
    columns = list(dict.fromkeys(record.measure for record in chosen if record.subject))
    columns = columns or list(dict.fromkeys(record.measure for record in chosen))[:1]
    if not columns:
        return None
    cells: dict[str, dict[str, float]] = {}
    for record in sorted(chosen, key=lambda record: not record.subject):  # classes first, the means last
        if record.measure in columns:
            cells.setdefault(record.subject or 'mean', {})[record.measure] = record.number
    rows = [(name, *(row.get(column, NAN) for column in columns)) for name, row in cells.items()]
    alone = {record.measure: record.number for record in chosen if record.measure not in columns}
    rows += [(measure, number, *[NAN] * (len(columns) - 1)) for measure, number in alone.items()]
    return ScoreTable('Percent, on validation scenes', ('Class', *columns), rows)


def result_table(records: Sequence[ScoreRecord]) -> str:
    """All class scores as plain text, one line a class; a dash where there was nothing to find."""
    points = point_table(records)
    if points is not None:
        return _text(points, 44)
    return format_table([record for record in records if record.measure in BOX_MEASURES])


def final_text(records: Sequence[ScoreRecord], labels: Mapping[str, Any]) -> str:
    """What a run prints in the end: its scores, and what can be said of labels that nobody can score.

    Args:
        records: Of the last validation.
        labels: Summary of the last round of labels; read is its ``estimate``.
    """
    agreement = [record for record in records if record.table == 'agreement']
    scored = [record for record in records if record.table != 'agreement']
    lines = [result_table(scored)] if scored or not agreement else []
    if agreement or has_estimate(labels):
        lines.append(f'pseudo labels: {estimate_text(labels)}')
    return '\n'.join([*lines, *(f'network: {record.number:.1f} % {record.measure}' for record in agreement)])


def _text(table: ScoreTable, widest: int) -> str:
    width = min(widest, max(len(str(row[0])) for row in table.rows)) + 2
    lines = [f'{table.head[0].lower():<{width}}' + ''.join(f'{name:>10}' for name in table.head[1:])]
    for name, *values in table.rows:
        lines.append(f'{name:<{width}}' + ''.join(f'{"-" if math.isnan(v) else f"{v:.2f}":>10}' for v in values))
    return '\n'.join(lines)


def headlines(records: Sequence[ScoreRecord]) -> dict[str, str]:
    """The numbers that stand on top of the page."""
    return {r.headline: f'{r.value:.1f} %' for r in records if r.headline and r.value is not None}


def loss_charts(losses: Mapping[str, Mapping[str, float]]) -> list[Chart]:
    """Mean losses of every epoch, a small chart each, since their sizes differ; none before the first epoch."""
    epochs = sorted(losses, key=int)
    names = [name for name in losses[epochs[0]] if name.startswith('loss')] if epochs else []
    if len(names) == 2:  # the sum and its only part
        names = names[:1]
    x = [int(epoch) for epoch in epochs]
    lines = {name: Series(x, [losses[epoch].get(name, NAN) for epoch in epochs]) for name in names}
    titles = {name: 'Training loss, the sum' if name == 'loss' else f'Training: {name}' for name in names}
    return [Chart(titles[name], 'epoch', 'mean', {name: line}, small=True) for name, line in lines.items()]


def score_chart(validation: Mapping[int, Sequence[ScoreRecord]]) -> Chart | None:
    """Moderate 3D AP, or the means of segmentation, of every validation; None where there are fewer than two.

    Args:
        validation: Records by epoch, in the order of the epochs.
    """
    if len(validation) < 2:
        return None
    epochs = list(validation)
    first = validation[epochs[0]]
    boxes = [record.name for record in first if record.measure == '3d AP R40' and record.level == 'moderate']
    means = [record.name for record in first if record.table in CLASS_TABLES and not record.subject]
    if not boxes and not means:
        return None
    numbers = {epoch: {record.name: record.number for record in records} for epoch, records in validation.items()}
    lines = {name: Series(epochs, [numbers[epoch].get(name, NAN) for epoch in epochs]) for name in boxes or means}
    return Chart('Moderate 3D AP (R40)' if boxes else 'Validation scores', 'epoch', '%', lines, y_low=0.0)


def label_charts(rounds: Sequence[Mapping[str, Any]]) -> list[Chart]:
    """Coverage and precision of the pseudo labels by round, and how far instance centres are off."""
    known = [entry for entry in rounds if entry.get('mean_precision') is not None]
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
