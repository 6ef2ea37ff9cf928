"""Few clicks propagated over scans: nearest label, plain random walker and ours, a row a scan and budget.

A folder of real data holds ``oakland`` and ``semantickitti``; an npz file has xyz (N, 3) metres, semantic (N,)
(-1 = unknown), optional rgb (N, 3) 0-255 and intensity (N,). Made-up rooms need no data.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from rm3d_plugin.datasets.base import DatasetNotFoundError
from rm3d_plugin.datasets.kitti_format import read_velodyne
from rm3d_plugin.datasets.oakland_format import merge_ids as merge_oakland
from rm3d_plugin.datasets.oakland_format import read_tile
from rm3d_plugin.datasets.scannet_format import class_of_nyu40
from rm3d_plugin.datasets.semantickitti_format import merge_ids, read_labels
from rm3d_plugin.datasets.synthetic.rooms import make_room
from rm3d_plugin.evaluation.realism import ROOM_POINTS
from rm3d_plugin.experiments.benchmarks.measure import machine
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud, prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.propagate import propagate_prepared
from rm3d_plugin.pseudo_labels.propagation.scores import (
    BUDGETS,
    draw_clicks,
    painted,
    propagation_scores,
    shown,
    unlabelled_miou,
)
from rm3d_plugin.structures import PointCloud

NAME = 'propagate-clicks'
HELP = 'mIoU and seconds of few clicks propagated over each real scan'
# Scans on which constants were chosen: Oakland's part2, SemanticKITTI's sequence 00, the first six rooms.
CHOSEN = ('part2', '00/', *(f'room{number:02d}' for number in range(6)))
ROOM_SEED, ROOM_SPACING = 7, 0.02  # metres between points before ROOM_POINTS of them are drawn


class Row(NamedTuple):
    """mIoU of one scan and budget in percent, on points outside of the strokes; NaN where something was not asked.

    Attributes:
        nearest: Each point as the nearest labelled one.
        place_and_colour: The same with colours as coordinates.
        walker: Plain random walker.
        ours: Ours.
        estimate: Of ours.
        low: End of its interval.
        high: End of its interval.
        seconds: Ours took.
        prepared: Seconds that the preparation took.
        middles: Ours from the clicks in the middle of the strokes alone.
    """

    nearest: float
    place_and_colour: float
    walker: float
    ours: float
    estimate: float
    low: float
    high: float
    seconds: float
    prepared: float
    middles: float


class Scan(NamedTuple):
    """A scan and its true classes."""

    name: str
    cloud: PointCloud
    semantic: np.ndarray


def add_scan_arguments(parser: argparse.ArgumentParser) -> None:
    """Options that name scans whose classes are known, see :func:`scans_asked`."""
    parser.add_argument('sources', nargs='*', type=Path, help='folder of real data, or npz files')
    parser.add_argument('--rooms', type=int, default=0, help='made-up rooms of 50,000 points besides; default 0')
    parser.add_argument('--seeds', nargs='+', type=int, default=[0], help='of the drawn clicks; default 0')
    parser.add_argument(
        '--half',
        choices=['chosen', 'apart', 'all'],
        default='all',
        help='chosen: the scans on which constants were chosen; apart: the others; default all',
    )


def scans_asked(args: argparse.Namespace) -> Iterator[Scan]:
    """The scans that options name."""
    for scan in chain(chain.from_iterable(map(scans_of, args.sources)), made_up_rooms(args.rooms)):
        if args.half == 'all' or (args.half == 'chosen') == scan.name.startswith(CHOSEN):
            yield scan


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    add_scan_arguments(parser)
    parser.add_argument('--no-walker', action='store_true', help='leave the plain random walker out (it is slow)')
    parser.add_argument('--stroke', type=float, default=0.0, help='metres around a click that it paints; default 0')
    parser.set_defaults(repeats=1)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """A line a scan and budget on the way; then means by budget and seed."""
    rows: dict[str, list[Row]] = {}
    for scan in scans_asked(args):
        for budget, row in rows_of(scan, args.seeds, not args.no_walker, args.stroke):
            rows.setdefault(budget, []).append(row)
    return {budget: summary(each) for budget, each in rows.items()} | {'machine': machine()}


def oakland(root: Path) -> Iterator[Scan]:
    """Every tile."""
    for path in sorted(root.glob('oakland/*.xyz_label_conf')):
        tile = read_tile(path)
        name = path.stem.removeprefix('oakland_')
        yield Scan(name, PointCloud.from_world(tile.xyz), np.asarray(merge_oakland(tile.label, path), np.int64))


def semantickitti(root: Path) -> Iterator[Scan]:
    """Every labelled scan; the remission where there is one."""
    for labels in sorted(root.glob('semantickitti/sequences/*/labels/*.label')):
        points = read_velodyne(labels.parent.parent / 'velodyne' / f'{labels.stem}.bin')
        strength = np.clip(points[:, 3], 0.0, 1.0) if points[:, 3].any() else None
        semantic = merge_ids(read_labels(labels, len(points)).semantic, labels)
        name = f'{labels.parent.parent.name}/{labels.stem}'
        yield Scan(name, PointCloud(points[:, :3], intensity=strength), np.asarray(semantic, np.int64))


def made_up_rooms(count: int) -> Iterator[Scan]:
    """Rooms of as many points as the real ones that they were compared with, in ScanNet's twenty classes."""
    for number in range(count):
        room = make_room(ROOM_SEED, number, ROOM_SPACING)
        order = np.random.default_rng(number).permutation(len(room))[:ROOM_POINTS]
        cloud = PointCloud(room.aligned[order].astype(np.float32), colors=room.colors[order] / 255.0)
        yield Scan(f'room{number:02d}', cloud, np.asarray(class_of_nyu40(room.nyu40)[order], np.int64))


def stored(path: Path) -> Scan:
    """A scan of an npz file."""
    with np.load(path, allow_pickle=False) as file:
        channels = {'colors': file['rgb'] / 255.0} if 'rgb' in file else {}
        channels |= {'intensity': file['intensity']} if 'intensity' in file else {}
        return Scan(path.stem, PointCloud.from_world(file['xyz'], **channels), file['semantic'].astype(np.int64))


def plain_walker(scene: PreparedCloud) -> scipy.sparse.csr_array:
    """Weights of a random walker with fixed scales: degrees, Lab units, curvature; a floor that needs no scan's own."""
    return scene.graphs[1].weights


def walked(weights: scipy.sparse.csr_array, clicked: np.ndarray, classes: np.ndarray) -> np.ndarray:
    """What the plain random walker says, by conjugate gradients at every point."""
    free = np.setdiff1d(np.arange(weights.shape[0]), clicked)
    degree = np.asarray(weights.sum(axis=1)).ravel()
    matrix = (scipy.sparse.diags_array(degree[free] + 1e-9) - weights[free][:, free]).tocsr()
    present, own = np.unique(classes, return_inverse=True)
    given = np.eye(len(present))[own]
    shares, pull = np.zeros((len(degree), len(present))), weights[free][:, clicked] @ given
    shares[clicked] = given
    scale = scipy.sparse.diags_array(1.0 / matrix.diagonal())
    for column in range(len(present)):
        shares[free, column] = scipy.sparse.linalg.cg(matrix, pull[:, column], rtol=1e-3, maxiter=400, M=scale)[0]
    return np.asarray(present[shares.argmax(axis=1)])


def rows_of(scan: Scan, seeds: list[int], walker: bool, stroke: float = 0.0) -> Iterator[tuple[str, Row]]:
    """Budget and seed, and what came out."""
    began = time.perf_counter()
    scene = prepare_cloud(scan.cloud)
    prepared = time.perf_counter() - began
    weights, classes = plain_walker(scene) if walker else None, int(scan.semantic.max()) + 1
    for seed in seeds:
        for budget in BUDGETS:
            middles = draw_clicks(scan.semantic, budget, np.random.default_rng(seed))
            clicked = painted(scan.cloud.xyz, scan.semantic, middles, stroke)
            score = propagation_scores(scene, scan.semantic, clicked)
            floor = np.nan
            if weights is not None:
                said = walked(weights, clicked, scan.semantic[clicked])
                floor = unlabelled_miou(said, scan.semantic, clicked)
            estimate = score.result.estimate
            told = (np.nan, np.nan, np.nan) if estimate is None else (estimate.miou, estimate.low, estimate.high)
            alone = np.nan
            if stroke > 0:
                said = propagate_prepared(scene, shown(scan.semantic, middles), classes).semantic
                alone = unlabelled_miou(said, scan.semantic, clicked)
            row = Row(
                score.nearest,
                score.place_and_colour,
                floor,
                score.propagated,
                *told,
                score.seconds,
                prepared,
                alone,
            )
            line = ' '.join(f'{value:6.1f}' for value in row)
            text = f'{scan.name:16s} seed {seed} {budget:14s} {line}  {score.result.choice.candidate}'
            print(text, file=sys.stderr, flush=True)
            yield f'{budget}, seed {seed}', row


def summary(rows: list[Row]) -> dict[str, float | None]:
    """Means over scans, the worst difference to the better trivial answer and to the walker, and the estimates.

    Args:
        rows: Of :func:`rows_of`, one a scan.

    Returns:
        Name -> mIoU in percent, seconds or number; None where there is nothing to average.
    """
    table = dict(zip(Row._fields, np.array(rows).T, strict=True))
    known, near = np.isfinite(table['estimate']), np.fmax(table['nearest'], table['place_and_colour'])
    told, low, high, ours = (each[known] for each in (table['estimate'], table['low'], table['high'], table['ours']))
    numbers = {
        'scans': len(rows),
        'nearest_miou': _mean(table['nearest']),
        'place_and_colour_miou': _mean(table['place_and_colour']),
        'walker_miou': _mean(table['walker']),
        'ours_miou': _mean(table['ours']),
        'middles_miou': _mean(table['middles']),
        'worst_against_trivial': _least(table['ours'] - near),
        'worst_against_walker': _least(table['ours'] - table['walker']),
        'intervals': int(known.sum()),
        'intervals_that_hold_percent': 100 * _mean((low <= ours) & (ours <= high)),
        'interval_width': _mean(high - low),
        'estimate_error': _mean(np.abs(told - ours)),
        'seconds': _mean(table['seconds']),
        'seconds_prepare': _mean(table['prepared']),
    }
    return {name: None if np.isnan(value) else round(value, 1) for name, value in numbers.items()}


def _mean(values: np.ndarray) -> float:
    there = values[np.isfinite(values)]
    return float(there.mean()) if len(there) else float('nan')


def _least(values: np.ndarray) -> float:
    there = values[np.isfinite(values)]
    return float(there.min()) if len(there) else float('nan')


def scans_of(source: Path) -> Iterator[Scan]:
    """The scan of a file, or all of a folder.

    Raises:
        DatasetNotFoundError: There is no scan.
    """
    if source.is_file():
        yield stored(source)
        return
    scans = chain(oakland(source), semantickitti(source))
    first = next(scans, None)
    if first is None:
        raise DatasetNotFoundError(f'{source}: expected oakland/*.xyz_label_conf or semantickitti/sequences inside')
    yield from chain([first], scans)
