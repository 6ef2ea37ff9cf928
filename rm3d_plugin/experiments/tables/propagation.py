"""Label propagation within one scan: a few labelled points of each class, scored on all others of the same scan."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from rm3d_plugin.evaluation.functional.semantic_iou import confusion_counts, semantic_scores
from rm3d_plugin.experiments.benchmarks.propagate_clicks import plain_walker, walked
from rm3d_plugin.experiments.kept import kept_rows
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section, bar_figure
from rm3d_plugin.experiments.runner import Commands, final_scores, run_folder, run_rows
from rm3d_plugin.experiments.scores import label_source
from rm3d_plugin.experiments.spec import OURS, PAPER, Request
from rm3d_plugin.experiments.tables.real_scans import Scan, leaf_name, real_scans, scan_rows
from rm3d_plugin.labeling import LabelSource
from rm3d_plugin.pseudo_labels.propagation import propagate
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import UNLABELLED


class UntrainedScores(NamedTuple):
    """mIoU, percent, on the unlabelled points of one scan, of what trains nothing.

    Attributes:
        nearest: Every point as the labelled point nearest to it.
        walker: Plain random walker on the point graph.
        label: What ``rm3d label`` writes.
    """

    nearest: float
    walker: float
    label: float


class MethodScores(NamedTuple):
    """mIoU, percent, on the unlabelled points of one scan, of what one strategy says.

    Attributes:
        first: Labels of round 0, which ask no network; points without one are wrong.
        first_filled: The same, points without one as the nearest that has one.
        network: The network at the end.
        last: Labels of the last round; the network says what the other points are.
        last_filled: The same labels, the others as the nearest point that has one.
    """

    first: float
    first_filled: float
    network: float
    last: float
    last_filled: float


@dataclass(frozen=True)
class PropagationScores:
    """What is said of one scan.

    Attributes:
        labelled_only: mIoU, percent, of a network that was trained on the labelled points alone.
        untrained: Without training.
        paper: RM3D as in the paper.
        ours: RM3D.
    """

    labelled_only: float
    untrained: UntrainedScores
    paper: MethodScores
    ours: MethodScores

    def sections(self) -> dict[str, dict[str, float]]:
        """Section of the table -> key of a column -> mIoU."""
        alone = {**self.untrained._asdict(), 'labelled_only': self.labelled_only}
        return {TRIVIAL: alone, PAPER: self.paper._asdict(), OURS: self.ours._asdict()}


TRIVIAL = 'Without pseudo labels of several rounds'
UNTRAINED = {
    'nearest': 'nearest labelled point',
    'walker': 'plain random walker',
    'label': '`rm3d label`, no training',
    'labelled_only': 'network on the labelled points alone',
}
METHOD = {
    'first': 'labels of round 0, the rest wrong',
    'first_filled': 'labels of round 0, the rest as the nearest',
    'network': 'network alone',
    'last': 'labels, the rest by the network',
    'last_filled': 'labels, the rest as the nearest',
}
COLUMNS = {TRIVIAL: UNTRAINED, PAPER: METHOD, OURS: METHOD}
RECORDS = {TRIVIAL: '', PAPER: 'paper_', OURS: 'rm3d_'}  # before the keys of the columns


def score_scan(scan: Scan, request: Request) -> PropagationScores:
    """Scores of the finished runs on one scan, and of what needs no network.

    Args:
        scan: Which.
        request: Folder, seed and further config keys of the runs.
    """
    rows = scan_rows(scan, request.out / 'configs')
    scores = {name: final_scores(request.out, row, request.seed) for name, row in rows.items()}
    folders = {name: run_folder(request.out, row, request.seed) for name, row in rows.items()}
    source = label_source(folders['ours'])
    (untrained,) = kept_rows(
        request.out / 'measured' / f'{leaf_name(scan)}_seed{request.seed}.json',
        {'scan': scan.name, 'seed': request.seed, 'points': sum(map(int, source.point_counts()))},
        UntrainedScores,
        lambda: [untrained_scores(source)],
    )
    return PropagationScores(
        scores['labelled_only']['mIoU'],
        untrained,
        method_scores(source, folders['paper'], scores['paper']),
        method_scores(source, folders['ours'], scores['ours']),
    )


def untrained_scores(source: LabelSource) -> UntrainedScores:
    """Scores of what trains nothing.

    Args:
        source: The scans, with the budget of a run.
    """

    def nearest(index: int) -> Int[np.ndarray, ' points']:
        return filled(source.load_cloud(index).xyz, source.annotated_labels(index).semantic)

    def walker(index: int) -> Int[np.ndarray, ' points']:
        annotated = source.annotated_labels(index).semantic
        clicked = np.flatnonzero(annotated >= 0)
        return walked(plain_walker(source.load_cloud(index)), clicked, annotated[clicked])

    def label(index: int) -> Int[np.ndarray, ' points']:
        return propagate(
            source.load_cloud(index), source.annotated_labels(index).semantic, len(source.classes)
        ).semantic

    return UntrainedScores(*(hidden_miou(source, said) for said in (nearest, walker, label)))


def method_scores(source: LabelSource, work_dir: Path, final: Mapping[str, float]) -> MethodScores:
    """Scores of the labels of a run and of its network.

    Args:
        source: The scans, with the budget of the run.
        work_dir: Of the run.
        final: Its final scores.
    """
    store = LabelStore(work_dir / 'labels')

    def labels(number: int, index: int) -> Int[np.ndarray, ' points']:
        return store.read(source.scene_ids[index], number).semantic

    def whole(number: int, index: int) -> Int[np.ndarray, ' points']:
        return filled(source.load_cloud(index).xyz, labels(number, index))

    return MethodScores(
        first=hidden_miou(source, partial(labels, 0)),
        first_filled=hidden_miou(source, partial(whole, 0)),
        network=final['network/mIoU'],
        last=final['mIoU'],
        last_filled=hidden_miou(source, partial(whole, store.rounds()[-1])),
    )


def hidden_miou(source: LabelSource, said: Callable[[int], Int[np.ndarray, ' points']]) -> float:
    """mIoU, percent, on the points that the budget does not show, over all scenes.

    Args:
        source: Scenes whose truth is known.
        said: Class of each point of a scene, -1 = none, which is wrong.
    """
    classes = len(source.classes)
    counts = np.zeros((classes, classes + 1), dtype=np.int64)
    for index in range(len(source.scene_ids)):
        truth = source.truth(index)
        assert truth is not None and truth.semantic is not None, 'hidden_miou: these scans have labels'
        hidden = np.where(source.annotated_labels(index).semantic >= 0, UNLABELLED, truth.semantic)
        counts += confusion_counts(said(index), hidden, classes)
    return 100 * float(semantic_scores(counts).mean_iou)


def filled(xyz: np.ndarray, semantic: Int[np.ndarray, ' points']) -> Int[np.ndarray, ' points']:
    """Unlabelled points take the class of the nearest labelled one.

    >>> filled(np.array([[0.0, 0, 0], [1, 0, 0], [4, 0, 0]]), np.array([2, -1, 5])).tolist()
    [2, 2, 5]
    """
    known = np.flatnonzero(semantic >= 0)
    return np.where(semantic >= 0, semantic, nearest_label(xyz, known, semantic[known]))


def propagation_table(request: Request, commands: Commands | None = None) -> FilledTable:
    """Train on every real scan that is there by itself, and score it.

    Args:
        request: Its ``data_root`` holds ``oakland`` or ``semantickitti`` (default: environment variable
            RM3D_REAL_DATA); ``scenes`` of each are taken, at most, whole.
        commands: What trains.

    Raises:
        ConfigError: There are no real scans, or a run failed.
    """
    scans = real_scans(request)
    rows = [row for scan in scans for row in scan_rows(scan, request.out / 'configs').values()]
    run_rows(rows, replace(request, seeds=(request.seed,)), commands)
    return fill_propagation({scan.name: score_scan(scan, request) for scan in scans}, request.seed)


def fill_propagation(scores: Mapping[str, PropagationScores], seed: int) -> FilledTable:
    """A section a kind of answer; a row a scan, and their mean."""
    found = {name: row.sections() for name, row in scores.items()}
    sections = tuple(_section(title, {name: row[title] for name, row in found.items()}) for title in COLUMNS)
    records = [
        {f'{RECORDS[title]}{key}': value for title, cells in row.items() for key, value in cells.items()}
        for row in found.values()
    ]
    return FilledTable(
        title=f'mIoU (%) on the unlabelled points of the same scan; at most 20 labelled points a class, seed {seed}',
        notes=(),
        sections=sections,
        records=tuple({'scan': name, 'seed': seed, **record} for name, record in zip(found, records, strict=True)),
        figure=lambda: bar_figure(sections, len(METHOD), 'mIoU, percent'),
    )


def _section(title: str, rows: Mapping[str, Mapping[str, float]]) -> Section:
    heads = COLUMNS[title]
    means = {key: float(np.mean([row[key] for row in rows.values()])) for key in heads}
    cells = {
        name: tuple(Cell(f'{row[key]:.1f}', (row[key],)) for key in heads)
        for name, row in {**rows, 'mean': means}.items()
    }
    return Section(title, ('scan', *heads.values()), tuple(NamedRow(name, each) for name, each in cells.items()))
