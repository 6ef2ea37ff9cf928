"""Coverage and precision of the pseudo labels of each round, as the paper shows them, on synthetic and real scans."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import mean
from typing import Any, NamedTuple

import numpy as np

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.evaluation.functional import SceneTruth
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section, bar_figure
from rm3d_plugin.experiments.runner import Commands, run_folder, run_rows
from rm3d_plugin.experiments.scores import COVERAGE, PRECISION, label_source
from rm3d_plugin.experiments.spec import BUDGETS, OURS, PAPER, Request, Row, method_rows
from rm3d_plugin.experiments.tables.real_scans import real_scans, scan_rows
from rm3d_plugin.labeling import LabelSource
from rm3d_plugin.labeling.round_summary import summarise_points
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import Boxes3D, PseudoLabels

SYNTHETIC = {'rooms': 'scannet', 'streets': 'semantickitti'}  # kind of scenes -> data set of the configs
SYNTHETIC_BUDGETS = ('0p2pct', 'onept')
NEAREST = 'nearest labelled point'
REAL = 'real scans, mean'
Shares = Mapping[str, Sequence['LabelShares']]  # method -> one a round


class LabelShares(NamedTuple):
    """Of the labels of a round, percent.

    Attributes:
        coverage: Points that have a label.
        precision: Pseudo labels that are right; NaN where there are none.
    """

    coverage: float
    precision: float


class Pair(NamedTuple):
    """Both methods on the same data with the same labelled points."""

    paper: Row
    ours: Row


def pseudo_label_table(request: Request, commands: Commands | None = None) -> FilledTable:
    """Train both methods on every kind of scenes, and tell what their label stores say of each round.

    In the folder of the table ``propagation`` its runs are taken up, and so are those of the tables of rooms and
    streets.

    Args:
        request: Its ``data`` are kinds of scenes; see :func:`real_scans`. One run each, with its ``seed``.
        commands: What trains.

    Raises:
        ConfigError: None of the data are there, or a run failed.
    """
    synthetic, real = synthetic_pairs(request), real_pairs(request)
    pairs = {**synthetic, **real}
    if not pairs:
        raise ConfigError(f'nothing to train on: none of {", ".join(request.data)} is there')
    run_rows([row for pair in pairs.values() for row in pair], replace(request, seeds=(request.seed,)), commands)
    shares = {name: shares_of(pair, request) for name, pair in pairs.items()}
    means = {REAL: mean_shares([shares[name] for name in real])} if real else {}
    return fill_pseudo_labels({name: shares[name] for name in synthetic} | means, shares, request.seed)


def synthetic_pairs(request: Request) -> dict[str, Pair]:
    """Rooms and streets, by data and budget; the runs are those of the tables of rooms and streets."""
    pairs = {}
    for kind, data in SYNTHETIC.items():
        for budget in SYNTHETIC_BUDGETS if request.wants(kind) else ():
            _, paper, ours = method_rows('sem', data, [budget], full=False)
            pairs[f'synthetic {kind} ({BUDGETS[budget]})'] = Pair(paper, ours)
    return pairs


def real_pairs(request: Request) -> dict[str, Pair]:
    """Every real scan that is there; without any, the log says where they were looked for."""
    try:
        scans = real_scans(request)
    except ConfigError as error:
        request.log(f'real scans are left out: {error}')
        return {}
    rows = {scan.name: scan_rows(scan, request.out / 'configs') for scan in scans}
    return {name: Pair(each['paper'], each['ours']) for name, each in rows.items()}


def shares_of(pair: Pair, request: Request) -> Shares:
    """What the finished runs of a pair say of each round, and what the nearest labelled point is worth."""
    folders = [run_folder(request.out, row, request.seed) for row in pair]
    paper, ours = map(shares_by_round, folders)
    return {NEAREST: [nearest_shares(label_source(folders[0]))], PAPER: paper, OURS: ours}


def shares_by_round(work_dir: Path) -> list[LabelShares]:
    """Of each round of a run."""
    store = LabelStore(work_dir / 'labels')
    return [_shares(store.summary(number)) for number in store.rounds()]


def nearest_shares(source: LabelSource) -> LabelShares:
    """Every point as the nearest labelled point of its scene.

    Args:
        source: Scenes whose truth is known.
    """
    return _shares(summarise_points(_as_nearest(source), source.classes))


def _as_nearest(source: LabelSource) -> Iterator[tuple[PseudoLabels, SceneTruth]]:
    for index in range(len(source.scene_ids)):
        annotated, truth = source.annotated_labels(index).semantic, source.truth(index)
        assert truth is not None and truth.semantic is not None, 'nearest_shares: these scenes have labels'
        known = annotated >= 0
        said = nearest_label(source.load_cloud(index).xyz, np.flatnonzero(known), annotated[known])
        semantic = np.where(known, annotated, said)
        sure = (semantic >= 0).astype(np.float32)
        nothing = np.zeros(0, dtype=np.bool_)
        labels = PseudoLabels(semantic, np.full(len(said), -1), known, sure, Boxes3D.empty(), nothing)
        yield labels, SceneTruth(truth.semantic)


def _shares(summary: Mapping[str, Any]) -> LabelShares:
    precision = summary['precision']
    return LabelShares(100 * summary['coverage'], float('nan') if precision is None else 100 * precision)


def mean_shares(scans: Sequence[Shares]) -> Shares:
    """Mean over scans, by method and round; scans without pseudo labels do not count to the precision."""
    return {
        method: [_mean(each) for each in zip(*(scan[method] for scan in scans), strict=True)] for method in scans[0]
    }


def _mean(scans: Sequence[LabelShares]) -> LabelShares:
    known = [scan.precision for scan in scans if not np.isnan(scan.precision)]
    return LabelShares(mean(scan.coverage for scan in scans), mean(known) if known else float('nan'))


def fill_pseudo_labels(shown: Mapping[str, Shares], single: Mapping[str, Shares], seed: int) -> FilledTable:
    """A section a kind of data, then one a scan; a row a method and round.

    Args:
        shown: Data -> shares that come first and stand in the figure.
        single: Data -> shares of all that was measured.
        seed: Of the runs.
    """
    sections = tuple(_section(name, shares) for name, shares in {**shown, **single}.items())
    records = tuple(
        {'data': name, 'seed': seed, 'method': method, 'round': number, **each._asdict()}
        for name, shares in single.items()
        for method, rounds in shares.items()
        for number, each in enumerate(rounds)
    )
    return FilledTable(
        title=f'Coverage and precision of pseudo labels by round, in percent; seed {seed}',
        notes=('Coverage: points with a label. Precision: labels that are right, of those that nobody annotated.',),
        sections=sections,
        records=records,
        figure=lambda: bar_figure(sections[: len(shown)], 2, 'percent'),
    )


def _section(title: str, shares: Shares) -> Section:
    rows = [
        NamedRow(method if method == NEAREST else f'{method}, round {number}', tuple(map(_cell, each)))
        for method, rounds in shares.items()
        for number, each in enumerate(rounds)
    ]
    return Section(title, ('labels', COVERAGE, PRECISION), tuple(rows))


def _cell(value: float) -> Cell:
    return Cell('-' if np.isnan(value) else f'{value:.1f}', (value,))
