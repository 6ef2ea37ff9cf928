"""Few labels spread over real scans: nearest label, plain random walker and ours, a row a scan and budget.

    python tools/benchmarks/propagate_clicks.py [DATA_ROOT] [--seeds 0 1 2] [--half chosen|apart|all] [SCAN.npz ...]

DATA_ROOT (default: environment variable RM3D_REAL_DATA) holds ``oakland`` and ``semantickitti``; an npz file has xyz
(N, 3) metres, semantic (N,) (-1 = unknown), optional rgb (N, 3) 0-255 and intensity (N,).
"""

import argparse
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from rm3d_plugin.datasets.kitti_format import read_velodyne
from rm3d_plugin.datasets.oakland_format import merge_ids as merge_oakland
from rm3d_plugin.datasets.oakland_format import read_tile
from rm3d_plugin.datasets.semantickitti_format import merge_ids, read_labels
from rm3d_plugin.pseudo_labels.propagation.channels import channel_groups
from rm3d_plugin.pseudo_labels.propagation.neighborhoods import neighborhoods
from rm3d_plugin.pseudo_labels.propagation.point_graph import smoothed
from rm3d_plugin.pseudo_labels.propagation.prepared import prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.scores import BUDGETS, draw_clicks, propagation_scores, unlabelled_miou
from rm3d_plugin.structures import PointCloud

CHOSEN = ('part2', '00/')  # scans on which constants were chosen: Oakland's part2, SemanticKITTI's sequence 00


class Scan(NamedTuple):
    """A scan and its true classes."""

    name: str
    cloud: PointCloud
    semantic: np.ndarray


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


def stored(path: Path) -> Scan:
    """A scan of an npz file."""
    with np.load(path, allow_pickle=False) as file:
        channels = {'colors': file['rgb'] / 255.0} if 'rgb' in file else {}
        channels |= {'intensity': file['intensity']} if 'intensity' in file else {}
        return Scan(path.stem, PointCloud.from_world(file['xyz'], **channels), file['semantic'].astype(np.int64))


def plain_walker(cloud: PointCloud) -> scipy.sparse.csr_array:
    """Weights of a random walker with fixed scales: degrees, Lab units, curvature; a floor that needs no scan's own."""
    near, channels = neighborhoods(cloud.xyz), channel_groups(cloud)
    start, end = np.repeat(np.arange(len(cloud)), 12), near.nearest[:, 1:13].ravel()
    cosine = np.abs((near.normal[start] * near.normal[end]).sum(axis=1)).clip(0, 1)
    angle = 20.0 if cloud.colors is None else 7.0
    local = 2.0 * np.maximum(near.distance[:, 6], 1e-3)
    cost = (np.degrees(np.arccos(cosine)) / angle) ** 2 + (near.distance[:, 1:13] / local[:, None]).ravel() ** 2
    if cloud.colors is None:
        cost += ((near.shape[start, 5] - near.shape[end, 5]) / 0.03) ** 2
    else:
        lab = smoothed(channels[0], near.nearest)
        cost += (np.linalg.norm(lab[start] - lab[end], axis=1) / 10.0) ** 2
    if cloud.intensity is not None:
        cost += ((cloud.intensity[start] - cloud.intensity[end]) / 0.1) ** 2
    shape = (len(cloud), len(cloud))
    directed = scipy.sparse.coo_array((np.exp(-cost) + 1e-4, (start, end)), shape=shape).tocsr()
    return directed.maximum(directed.T).tocsr()


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


def rows_of(scan: Scan, seeds: list[int], walker: bool) -> Iterator[tuple[str, list[float]]]:
    """Budget and nearest, place and colour, walker, ours, estimate, low, high, seconds, seconds of the preparation."""
    began = time.perf_counter()
    scene = prepare_cloud(scan.cloud)
    prepared = time.perf_counter() - began
    weights = plain_walker(scan.cloud) if walker else None
    for seed in seeds:
        for budget in BUDGETS:
            clicked = draw_clicks(scan.semantic, budget, np.random.default_rng(seed))
            score = propagation_scores(scene, scan.semantic, clicked)
            floor = np.nan
            if weights is not None:
                said = walked(weights, clicked, scan.semantic[clicked])
                floor = unlabelled_miou(said, scan.semantic, clicked)
            estimate = score.result.estimate
            told = [np.nan] * 3 if estimate is None else [estimate.miou, estimate.low, estimate.high]
            row = [score.nearest, score.place_and_colour, floor, score.propagated, *told, score.seconds, prepared]
            line = ' '.join(f'{value:6.1f}' for value in row)
            print(f'{scan.name:16s} seed {seed} {budget:14s} {line}  {score.result.choice.candidate}', flush=True)
            yield f'{budget}, seed {seed}', row


def summary(rows: dict[str, list[list[float]]]) -> Iterator[str]:
    """Means over scans, the worst difference to the better trivial answer and to the walker, and the estimates."""
    for budget, each in rows.items():
        table = np.array(each)
        near, coloured, walker, ours = table[:, :4].T
        known = np.isfinite(table[:, 4])
        told, low, high = table[known, 4:7].T
        inside = (low <= ours[known]) & (ours[known] <= high)
        means = f'nearest {near.mean():.1f}, place and colour {_mean(coloured):.1f}, walker {_mean(walker):.1f}'
        trivial, floor = (ours - np.fmax(near, coloured)).min(), _least(ours - walker)
        worst = f'worst against the trivial {trivial:+.1f}, against the walker {floor:+.1f}'
        held, wide, off = 100 * _mean(inside), _mean(high - low), _mean(np.abs(told - ours[known]))
        intervals = f'of {known.sum()} intervals {held:.0f} % hold, {wide:.1f} wide, off by {off:.1f}'
        yield f'{budget:24s} {means}, ours {ours.mean():.1f}; {worst}; {intervals}'


def _mean(values: np.ndarray) -> float:
    there = values[np.isfinite(values)]
    return float(there.mean()) if len(there) else float('nan')


def _least(values: np.ndarray) -> float:
    there = values[np.isfinite(values)]
    return float(there.min()) if len(there) else float('nan')


def main() -> None:
    """Read the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('sources', nargs='*', help='folder of real data, or npz files')
    parser.add_argument('--seeds', nargs='+', type=int, default=[0])
    parser.add_argument('--half', choices=['chosen', 'apart', 'all'], default='all')
    parser.add_argument('--no-walker', action='store_true', help='leave the plain random walker out (it is slow)')
    args = parser.parse_args()
    sources = args.sources or [os.environ.get('RM3D_REAL_DATA', 'data')]
    rows: dict[str, list[list[float]]] = {}
    for scan in (scan for source in sources for scan in scans_of(Path(source))):
        if args.half != 'all' and (args.half == 'chosen') != scan.name.startswith(CHOSEN):
            continue
        for budget, row in rows_of(scan, args.seeds, not args.no_walker):
            rows.setdefault(budget, []).append(row)
    print('\n'.join(summary(rows)))


def scans_of(source: Path) -> Iterator[Scan]:
    """The scan of a file, or all of a folder."""
    if source.is_file():
        yield stored(source)
        return
    yield from oakland(source)
    yield from semantickitti(source)


if __name__ == '__main__':
    main()
