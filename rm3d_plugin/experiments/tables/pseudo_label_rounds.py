"""Pseudo labels round by round, with both strategies: how many points have one, how many are right.

Beside them stands the trivial answer: each point as the nearest labelled one.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.evaluation.functional import SceneTruth
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section
from rm3d_plugin.experiments.runner import Commands, run_folder, run_rows
from rm3d_plugin.experiments.scale import scaled_row
from rm3d_plugin.experiments.scenes import real_root
from rm3d_plugin.experiments.scores import label_source
from rm3d_plugin.experiments.spec import BUDGETS, WHOLE, Request, Row, Scale
from rm3d_plugin.experiments.tables.propagation import Scan, oakland_scans, scan_rows, semantickitti_scans
from rm3d_plugin.labeling import LabelSource
from rm3d_plugin.labeling.round_summary import summarise_points
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PseudoLabels
from rm3d_plugin.visualization.tables import LinePanel, draw_lines

STRATEGIES = {'paper': 'RM3D as in the paper', 'rm3d': 'RM3D'}
NEAREST = 'nearest'
METHODS = {NEAREST: 'nearest labelled point', **STRATEGIES}
SYNTHETIC = {'rooms': 'scannet', 'streets': 'semantickitti'}  # kind of scenes -> data set, as configs name it
SYNTHETIC_BUDGETS = ('0p2pct', 'onept')
REAL = 'Mean of the real scans'


class RoundShares(NamedTuple):
    """Labels of one round of one run; shares in percent.

    Attributes:
        data: Scan or scenes.
        method: Key of :data:`METHODS`.
        round: From 0, which asks no network.
        coverage: Of all points, those with a label.
        precision: Of the pseudo labels, those that are right; NaN where there are none.
    """

    data: str
    method: str
    round: int
    coverage: float
    precision: float


def synthetic_rows(kind: str, scale: Scale = WHOLE) -> dict[str, dict[str, Row]]:
    """Name of the data -> strategy -> what is trained, for synthetic rooms or streets."""
    rows = {}
    for budget in SYNTHETIC_BUDGETS:
        leaf, name = f'rm3d_sem_{SYNTHETIC[kind]}_{budget}', f'{kind} (synthetic), {BUDGETS[budget]}'
        trained = {
            'paper': Row(f'{name}: RM3D as in the paper', leaf, {'strategy': 'paper'}),
            'rm3d': Row(f'{name}: RM3D', leaf),
        }
        rows[name] = {strategy: scaled_row(row, scale) for strategy, row in trained.items()}
    return rows


def real_rows(scan: Scan, request: Request) -> dict[str, Row]:
    """Strategy -> what is trained on one scan; the runs are those of the table ``propagation`` in the same folder."""
    rows = scan_rows(scan, request.out / 'configs')
    return {strategy: rows[strategy] for strategy in STRATEGIES}


def real_scans(request: Request) -> list[Scan]:
    """The real scans there are, of the kinds that are asked for."""
    root = request.data_root or real_root()
    found = {
        'oakland': lambda: oakland_scans(root / 'oakland'),
        'semantickitti': lambda: semantickitti_scans(root / 'semantickitti', request.out / 'scans'),
    }
    return [scan for kind in request.data if kind in found for scan in found[kind]()[: request.scenes]]


def pseudo_label_table(request: Request, commands: Commands | None = None) -> FilledTable:
    """Train with both strategies on synthetic scenes and on each real scan by itself, and read the labels' records.

    Args:
        request: Its ``data`` are kinds of scenes; real ones are found in ``data_root`` (default: environment variable
            RM3D_REAL_DATA), ``scenes`` of each are taken, at most, whole; its seed draws the labelled points.
        commands: What trains.

    Raises:
        ConfigError: There is nothing to train on, or a run failed.
    """
    real = {scan.name: real_rows(scan, request) for scan in real_scans(request)}
    kinds = [kind for kind in request.data if kind in SYNTHETIC]
    made = {name: rows for kind in kinds for name, rows in synthetic_rows(kind, request.scale).items()}
    if not real and not made:
        raise ConfigError(f'nothing to train on: none of {", ".join(request.data)} is there')
    everything = real | made
    run_rows(
        [row for rows in everything.values() for row in rows.values()],
        replace(request, seeds=(request.seed,)),
        commands,
    )
    asked = [(name, key, row) for name, rows in everything.items() for key, row in rows.items()]
    shares = [share for name, key, row in asked for share in read(name, key, row, request)]
    shares += [nearest_shares(name, rows['rm3d'], request) for name, rows in everything.items()]
    return fill_rounds(shares, list(real), request.seed)


def read(data: str, method: str, row: Row, request: Request) -> list[RoundShares]:
    """What the label store of a finished run says of each round."""
    store = LabelStore(run_folder(request.out, row, request.seed) / 'labels')
    summaries = {number: store.summary(number) for number in store.rounds()}
    return [
        RoundShares(data, method, number, 100 * summary['coverage'], _percent(summary['precision']))
        for number, summary in summaries.items()
    ]


def nearest_shares(data: str, row: Row, request: Request) -> RoundShares:
    """The trivial answer to the labelled points of a finished run: each point as the nearest of them in its scene."""
    source = label_source(run_folder(request.out, row, request.seed))
    summary = summarise_points(as_nearest(source), source.classes)
    return RoundShares(data, NEAREST, 0, 100 * summary['coverage'], _percent(summary['precision']))


def as_nearest(source: LabelSource) -> Iterator[tuple[PseudoLabels, SceneTruth]]:
    """Labels of each scene, every point as the nearest labelled one, and its truth.

    Args:
        source: Scenes whose truth is known.
    """
    for index in range(len(source.scene_ids)):
        annotated, truth = source.annotated_labels(index).semantic, source.truth(index)
        assert truth is not None and truth.semantic is not None, 'as_nearest: these scenes have labels'
        known = annotated >= 0
        said = nearest_label(source.load_cloud(index).xyz, np.flatnonzero(known), annotated[known])
        sure, nothing = (said >= 0).astype(np.float32), np.zeros(0, dtype=np.bool_)
        labels = PseudoLabels(
            np.where(known, annotated, said), np.full(len(said), UNLABELLED), known, sure, Boxes3D.empty(), nothing
        )
        yield labels, SceneTruth(truth.semantic)


def _percent(share: float | None) -> float:
    return math.nan if share is None else 100 * share


def fill_rounds(shares: Sequence[RoundShares], real: Sequence[str], seed: int) -> FilledTable:
    """A section a scan or kind of scenes, a row a round; the mean of the real scans comes first.

    Args:
        shares: Of all data.
        real: Names of the real scans among them.
        seed: Of all runs.
    """
    means = mean_shares([share for share in shares if share.data in real])
    shown = [*means, *shares]
    names = list(dict.fromkeys(share.data for share in shown))
    panels = [_panel(name, shown) for name in names if name not in real]
    return FilledTable(
        title=f'Pseudo labels by round: points with one, and those of them that are right (%), seed {seed}',
        notes=(),
        sections=tuple(_section(name, shown) for name in names),
        records=tuple({'seed': seed, **share._asdict()} for share in shares),
        figure=lambda: draw_lines([panels], 'percent'),
    )


def mean_shares(shares: Sequence[RoundShares]) -> list[RoundShares]:
    """The mean over all data for each method and round; unknown precisions are left out."""
    groups: dict[tuple[str, int], list[RoundShares]] = {}
    for share in shares:
        groups.setdefault((share.method, share.round), []).append(share)
    return [
        RoundShares(REAL, *key, float(np.mean([share.coverage for share in own])), _mean(own))
        for key, own in groups.items()
    ]


def _mean(shares: Sequence[RoundShares]) -> float:
    known = [share.precision for share in shares if not math.isnan(share.precision)]
    return float(np.mean(known)) if known else math.nan


def _by_round(data: str, shares: Sequence[RoundShares]) -> dict[int, dict[str, RoundShares]]:
    """Round -> method -> its shares."""
    found: dict[int, dict[str, RoundShares]] = {}
    for share in shares:
        if share.data == data:
            found.setdefault(share.round, {})[share.method] = share
    return dict(sorted(found.items()))


def _section(data: str, shares: Sequence[RoundShares]) -> Section:
    heads = [f'{name}: {what}' for name in METHODS.values() for what in ('coverage', 'precision')]
    rows = []
    for number, own in _by_round(data, shares).items():
        cells = [cell for method in METHODS for cell in _cells(own.get(method))]
        rows.append(NamedRow(str(number), tuple(cells)))
    return Section(data, ('round', *heads), tuple(rows))


def _cells(share: RoundShares | None) -> list[Cell]:
    values = (math.nan, math.nan) if share is None else (share.coverage, share.precision)
    return [Cell('-') if math.isnan(value) else Cell(f'{value:.1f}', (value,)) for value in values]


def _panel(data: str, shares: Sequence[RoundShares]) -> LinePanel:
    rounds = _by_round(data, shares)
    lines: Mapping[str, list[float]] = {
        f'{name}: {what}': [getattr(own[key], what) if key in own else math.nan for own in rounds.values()]
        for key, name in METHODS.items()
        for what in ('coverage', 'precision')
    }
    return LinePanel(data, 'round', [str(number) for number in rounds], lines)
