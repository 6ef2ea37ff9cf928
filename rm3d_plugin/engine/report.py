"""Gathers what a run left behind for its HTML report."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mmengine.config import Config

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.storage import LabelStore, read_json
from rm3d_plugin.structures import Boxes3D, PointCloud, PseudoLabels, Regions
from rm3d_plugin.visualization import (
    BudgetSummary,
    Chart,
    Picture,
    ResultRow,
    RunReport,
    Series,
    draw_bev,
    scene_panels,
)

_SCORE = re.compile(
    r'(?P<name>\w+?)_(?P<metric>3d|bev)_(?P<level>easy|moderate|hard)_R40(@(?P<iou>[\d.]+)|(?P<loose>_loose)?)'
)
HEADLINES = {
    'mAP_3d_moderate_R40_loose': '3D AP, loose IoU',
    'mAP_3d_moderate_R40': '3D AP, official IoU',
}  # means, moderate
SHOWN_KEYS = ('descriptor', 'oversegmenter', 'strategy', 'budget', 'rounds', 'sigma', 'seed', 'data_root', 'batch_size')


def result_rows(scores: Mapping[str, float]) -> list[ResultRow]:
    """Rows (class, metric, easy, moderate, hard) of the 3D and bird's-eye AP (R40) among flat scores, percent."""
    table: dict[tuple[str, str], dict[str, float]] = {}
    for key, value in scores.items():
        match = _SCORE.fullmatch(key)
        if match:
            iou = f' @ {match["iou"]}' if match['iou'] else (' loose' if match['loose'] else '')
            name = 'mean' if match['name'] == 'mAP' else match['name']
            table.setdefault((name, f'{match["metric"]} AP R40{iou}'), {})[match['level']] = value
    nan = float('nan')
    return [
        ResultRow(name, metric, row.get('easy', nan), row.get('moderate', nan), row.get('hard', nan))
        for (name, metric), row in table.items()
    ]


def result_table(scores: Mapping[str, float]) -> str:
    """The same rows as plain text, one a line; a dash where there was nothing to find."""
    lines = [f'{"class":<12}{"metric":<22}{"easy":>8}{"moderate":>10}{"hard":>8}']
    for row in result_rows(scores):
        easy, moderate, hard = ('-' if math.isnan(v) else f'{v:.2f}' for v in (row.easy, row.moderate, row.hard))
        lines.append(f'{row.class_name:<12}{row.metric:<22}{easy:>8}{moderate:>10}{hard:>8}')
    return '\n'.join(lines)


def loss_chart(losses: Mapping[str, Mapping[str, float]]) -> Chart | None:
    """Mean losses of every epoch; None before the first."""
    epochs = sorted(losses, key=int)
    if not epochs:
        return None
    x = [int(epoch) for epoch in epochs]
    names = [name for name in losses[epochs[0]] if name.startswith('loss')]
    lines = {name: Series(x, [losses[epoch].get(name, float('nan')) for epoch in epochs]) for name in names}
    return Chart('Training losses', 'epoch', 'mean loss', lines)


def score_chart(validation: Mapping[str, Mapping[str, float]]) -> Chart | None:
    """Moderate 3D AP of every validation; None where there are fewer than two."""
    epochs = sorted(validation, key=int)
    if len(epochs) < 2:
        return None
    x = [int(epoch) for epoch in epochs]
    names = [key for key in validation[epochs[0]] if '_3d_moderate_R40' in key]
    lines = {name: Series(x, [validation[epoch][name] for epoch in epochs]) for name in names}
    return Chart('Moderate 3D AP (R40)', 'epoch', '%', lines, y_low=0.0)


def budget_of(store: LabelStore, classes: Sequence[str], name: Any) -> BudgetSummary | None:
    """The label budget kept beside the labels, or None."""
    path = store.root / 'budget.json'
    if not path.is_file():
        return None
    content = read_json(path)
    revealed, total = content['revealed_per_class'], content['total_per_class']
    counts = {cls: (int(revealed.get(str(i), 0)), int(total.get(str(i), 0))) for i, cls in enumerate(classes)}
    return BudgetSummary(str(name), content['hash'], counts, content['seed'])


def scene_picture(
    caption: str,
    cloud: PointCloud,
    classes: Sequence[str],
    truth: Truth | None,
    predicted: Boxes3D | None,
    regions: Regions | None = None,
    labels: PseudoLabels | None = None,
) -> Picture:
    """A scene from above: regions, labels, predictions, each with the truth where it is known."""
    panels = scene_panels(
        cloud.xyz,
        classes,
        regions=None if regions is None else regions.labels,
        semantic=None if labels is None else labels.semantic,
        truth=None if truth is None else truth.boxes,
        pseudo=None if labels is None else labels.boxes,
        predicted=predicted,
    )
    return Picture(caption, draw_bev(panels))


def run_report(
    config: Config,
    record: Mapping[str, Any],
    store: LabelStore,
    classes: Sequence[str],
    pictures: Sequence[Picture],
    seconds: Mapping[str, float],
) -> RunReport:
    """Everything the page shows."""
    charts = [loss_chart(record['losses']), score_chart(record['validation'])]
    rounds = [{'round': number, **store.summary(number)} for number in store.rounds()]
    final = record.get('final', {})
    headline = {name: f'{final[key]:.1f} %' for key, name in HEADLINES.items() if key in final}
    facts = {'epochs': len(record['losses']), 'label rounds': len(rounds), 'work dir': Path(config.work_dir).name}
    return RunReport(
        title=str(config.get('config_name', 'RM3D run')),
        synthetic=bool(config.get('is_demo', False)),
        summary={**headline, **facts},
        budget=budget_of(store, classes, config.get('budget', '')),
        results=result_rows(final),
        charts=[chart for chart in charts if chart is not None],
        rounds=rounds,
        pictures=pictures,
        config={key: config[key] for key in SHOWN_KEYS if key in config},
        config_text=config.pretty_text,
        seconds=seconds,
    )
