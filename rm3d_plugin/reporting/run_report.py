"""Gathers what a run left behind for its HTML report."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mmengine.config import Config

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.engine.hooks.run_record_hook import final_records, score_records
from rm3d_plugin.labeling.round_summary import box_warnings
from rm3d_plugin.reporting.scores import (
    headlines,
    label_charts,
    loss_charts,
    point_table,
    result_rows,
    score_chart,
)
from rm3d_plugin.storage import LabelStore, read_json
from rm3d_plugin.structures import Boxes3D, PointCloud, PseudoLabels, Regions
from rm3d_plugin.structures.label_estimate import estimate_text, has_estimate
from rm3d_plugin.visualization import (
    BudgetSummary,
    MergeReport,
    Picture,
    RoundTime,
    RunReport,
    draw_bev,
    scene_panels,
)

SHOWN_KEYS = ('descriptor', 'oversegmenter', 'strategy', 'budget', 'rounds', 'sigma', 'seed', 'data_root', 'batch_size')


def budget_of(store: LabelStore, classes: Sequence[str], name: Any) -> BudgetSummary | None:
    """The label budget kept beside the labels, or None."""
    path = store.root / 'budget.json'
    if not path.is_file():
        return None
    content = read_json(path)
    annotated, total = content['annotated_per_class'], content['total_per_class']
    counts = {cls: (int(annotated.get(str(i), 0)), int(total.get(str(i), 0))) for i, cls in enumerate(classes)}
    clicked = content['amount'].get('clicks') is not None
    unit = 'clicked points' if clicked else str(content.get('kind', 'boxes'))
    return BudgetSummary(str(name), content['hash'], counts, content['seed'], unit, not clicked)


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


def _told(number: int, summary: Mapping[str, Any]) -> dict[str, Any]:
    return {'round': number, **summary, 'warnings': box_warnings(summary)}


def run_report(
    config: Config,
    record: Mapping[str, Any],
    store: LabelStore,
    classes: Sequence[str],
    pictures: Sequence[Picture],
    seconds: Mapping[str, float],
    views: Mapping[str, Any] | None = None,
    merges: MergeReport | None = None,
    times: Sequence[RoundTime] = (),
) -> RunReport:
    """Everything the page shows; ``views`` and ``merges`` in segmentation only."""
    rounds = [_told(number, store.summary(number)) for number in store.rounds()]
    charts = [*loss_charts(record['losses']), score_chart(score_records(record)), *label_charts(rounds)]
    final = final_records(record)
    told = rounds and (has_estimate(rounds[-1]) or any(record.table == 'agreement' for record in final))
    estimate = {'pseudo labels': estimate_text(rounds[-1])} if told else {}
    facts = {'epochs': len(record['losses']), 'label rounds': len(rounds), 'work dir': Path(config.work_dir).name}
    return RunReport(
        title=str(config.get('config_name', 'RM3D run')),
        synthetic=bool(config.get('is_demo', False)),
        summary={**headlines(final), **estimate, **facts},
        budget=budget_of(store, classes, config.get('budget', '')),
        results=result_rows(final),
        scores=point_table(final),
        charts=[chart for chart in charts if chart is not None],
        rounds=rounds,
        pictures=pictures,
        views=views,
        merges=merges,
        config={key: config[key] for key in SHOWN_KEYS if key in config},
        config_text=config.pretty_text,
        seconds=seconds,
        times=times,
    )
