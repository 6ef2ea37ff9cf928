"""Clicks to quality: how right scans are after so many clicks, by where the next one falls and how labels spread."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
from jaxtyping import Float

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.benchmarks.clicks_to_quality import AT, GOALS
from rm3d_plugin.experiments.benchmarks.propagate_clicks import Scan, made_up_rooms, oakland, semantickitti
from rm3d_plugin.experiments.click_curves import BOUND, OURS, Curve, clicks_to, curves_of
from rm3d_plugin.experiments.kept import kept_rows
from rm3d_plugin.experiments.next_click import SCORES
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section
from rm3d_plugin.experiments.scenes import load_collections, real_root
from rm3d_plugin.experiments.spec import WHOLE, Request
from rm3d_plugin.visualization.tables import LinePanel, draw_lines

CLICKS = 30  # of each run
GROUPS = {
    'rooms': 'Rooms, synthetic', 'streets': 'Streets, synthetic', 'oakland': 'Oakland, real',
    'semantickitti': 'SemanticKITTI, real',
}  # fmt: skip
REAL = 'Real scans together'


def clicks_table(request: Request, scores: Sequence[str] = SCORES, clicks: int = CLICKS) -> FilledTable:
    """Click on every scan with every score and seed; scans that were measured are kept.

    Args:
        request: Its ``data`` are keys of :data:`GROUPS`; synthetic scans as many as ``scenes``, real ones all there are
            (in ``data_root``, default: environment variable RM3D_REAL_DATA), each whole. Where its scale is not the
            whole, as many real ones as ``scenes``.
        scores: Of :data:`~rm3d_plugin.experiments.next_click.SCORES`.
        clicks: Of each run.

    Raises:
        ConfigError: None of the data are there.
    """
    curves: dict[str, list[Curve]] = {}
    asked = {'seeds': list(request.seeds), 'clicks': clicks, 'scores': list(scores)}
    for group in (name for name in GROUPS if name in request.data):
        for scan in scans_of_group(group, request):
            path = request.out / 'measured' / f'clicks-to-quality_{group}_{scan.name.replace("/", "_")}.json'
            measure = partial(lambda own: list(curves_of(own, scores, request.seeds, clicks)), scan)
            curves.setdefault(group, []).extend(kept_rows(path, asked, Curve, measure))
            request.log(f'{GROUPS[group]}: {scan.name} done')
    if not curves:
        raise ConfigError(f'nothing to measure: none of {", ".join(request.data)} is there')
    return fill_clicks(curves, request.seeds)


def scans_of_group(group: str, request: Request) -> Iterator[Scan]:
    """Scans of one kind with their classes."""
    root = request.data_root or real_root()
    if group == 'rooms':
        yield from made_up_rooms(request.scenes)
    elif group == 'streets':
        for collection in load_collections(replace(request, data=('streets',), points=None)):
            yield from (Scan(scene.name, scene.cloud, scene.semantic) for scene in collection.scenes)
    else:
        scans = (oakland if group == 'oakland' else semantickitti)(root)
        yield from scans if request.scale == WHOLE else islice(scans, request.scenes)


def fill_clicks(curves: dict[str, list[Curve]], seeds: Sequence[int]) -> FilledTable:
    """A section a kind of scans, and one of all real ones."""
    real = [curve for group in ('oakland', 'semantickitti') for curve in curves.get(group, [])]
    shown = {GROUPS[group]: own for group, own in curves.items()} | ({REAL: real} if real else {})
    clicks = len(next(iter(curves.values()))[0].right)
    return FilledTable(
        title=f'Percent of the points right after so many clicks in all, and clicks to so many percent; seeds {seeds}',
        notes=(
            'Percent: the mean of scans and seeds. Clicks: the mean over the scans of the median of the seeds; a run '
            f'that misses the goal within {clicks} clicks counts as {clicks + 1}.',
            f'{", ".join(BOUND)}: the most that is possible, all points of as many classes as there are clicks.',
        ),
        sections=tuple(_section(title, own) for title, own in shown.items()),
        records=tuple(_record(group, curve) for group, own in curves.items() for curve in own),
        figure=lambda: draw_lines([[_panel(title, own) for title, own in shown.items()]], 'points right, percent'),
    )


def _record(group: str, curve: Curve) -> dict[str, Any]:
    head = {'data': group, 'scan': curve.scan, 'score': curve.score, 'labels': curve.labels, 'seed': curve.seed}
    return head | {f'after {count}': value for count, value in enumerate(curve.right, start=1)}


def _section(title: str, curves: Sequence[Curve]) -> Section:
    clicks = len(curves[0].right)
    at = [count for count in AT if count <= clicks]
    kinds = dict.fromkeys((curve.score, curve.labels) for curve in curves)
    scans = len({curve.scan for curve in curves})
    return Section(
        f'{title} ({scans})',
        ('next click, labels', *(f'after {count}' for count in at), *(f'to {goal} %' for goal in GOALS)),
        tuple(NamedRow(', '.join(kind), _cells(_of_kind(curves, kind), at)) for kind in kinds),
    )


def _of_kind(curves: Sequence[Curve], kind: tuple[str, str]) -> Float[np.ndarray, 'scans seeds clicks']:
    own = [curve for curve in curves if (curve.score, curve.labels) == kind]
    scans = dict.fromkeys(curve.scan for curve in own)
    return np.array([[curve.right for curve in own if curve.scan == scan] for scan in scans])


def _cells(right: Float[np.ndarray, 'scans seeds clicks'], at: Sequence[int]) -> tuple[Cell, ...]:
    means = [right[:, :, count - 1].ravel() for count in at]
    needed = [np.array([np.median(clicks_to(goal, scan)) for scan in right]) for goal in GOALS]
    return tuple(Cell(f'{values.mean():.1f}', tuple(values.tolist())) for values in (*means, *needed))


def _panel(title: str, curves: Sequence[Curve]) -> LinePanel:
    clicks = len(curves[0].right)
    kinds = dict.fromkeys((curve.score, curve.labels) for curve in curves)
    kinds = {kind: None for kind in kinds if kind[1] == OURS or kind[0] == 'chance' or kind == BOUND}
    ticks = [str(count) if count in (1, *AT) else '' for count in range(1, clicks + 1)]
    lines = {', '.join(kind): _of_kind(curves, kind).mean(axis=(0, 1)).tolist() for kind in kinds}
    return LinePanel(title, 'clicks', ticks, lines)
