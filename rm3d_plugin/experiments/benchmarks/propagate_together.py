"""Few clicks in each of several scans, which teach one another what classes look like; beside each scan by itself.

Sources as for ``propagate-clicks``. Tiles of Oakland, scans of SemanticKITTI, made-up rooms and npz files are a group
each, told by their names; the classes of all npz files must have the same numbers. All scans of a group are held in
memory. Where some scans of a group have a channel that others lack, it is left out of all.
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Int

from rm3d_plugin.experiments.benchmarks.measure import machine
from rm3d_plugin.experiments.benchmarks.propagate_clicks import Scan, add_scan_arguments, scans_asked
from rm3d_plugin.labeling.scan_knowledge import ScanKnowledge
from rm3d_plugin.pseudo_labels.propagation import Beside, PreparedCloud, WalkerRules, prepare_cloud, propagate_prepared
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label
from rm3d_plugin.pseudo_labels.propagation.scores import Budget, draw_clicks, unlabelled_miou

NAME = 'propagate-together'
HELP = 'mIoU of few clicks in each of several real scans that teach one another'
BUDGETS: tuple[Budget, ...] = ('one a class', 'twenty a scan')
GROUPS = ('part', 'room')  # how names of tiles and made-up rooms begin; SemanticKITTI's have a slash


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    add_scan_arguments(parser)
    parser.set_defaults(repeats=1)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """A line a group, seed and budget on the way, the means of its scans; then the same."""
    groups: dict[str, list[Scan]] = {}
    for scan in scans_asked(args):
        groups.setdefault(group_of(scan.name), []).append(scan)
    rows = {}
    for group, scans in groups.items():
        for name, row in rows_of(scans, args.seeds):
            rows[f'{group}, {name}'] = row
            print(f'{group:16s} {name:24s} {row}', file=sys.stderr, flush=True)
    return rows | {'machine': machine()}


def group_of(name: str) -> str:
    """Scans of one group teach one another.

    >>> group_of('00/000010'), group_of('part2_ac'), group_of('room03'), group_of('hall')
    ('sequences', 'part', 'room', 'files')
    """
    if '/' in name:
        return 'sequences'
    return next((start for start in GROUPS if name.startswith(start)), 'files')


def with_same_channels(scans: Sequence[Scan]) -> list[Scan]:
    """The scans without what some of them lack."""
    clouds = [scan.cloud for scan in scans]
    if any(cloud.intensity is None for cloud in clouds):
        clouds = [replace(cloud, intensity=None) for cloud in clouds]
    if any(cloud.colors is None for cloud in clouds):
        clouds = [replace(cloud, colors=None) for cloud in clouds]
    return [scan._replace(cloud=cloud) for scan, cloud in zip(scans, clouds, strict=True)]


def rows_of(scans: Sequence[Scan], seeds: Sequence[int]) -> Iterator[tuple[str, dict[str, float]]]:
    """For each budget and seed mean IoU, percent: of the nearest click, of each scan by itself, and together."""
    scans = with_same_channels(scans)
    classes = max(int(scan.semantic.max()) for scan in scans) + 1
    prepared = {scan.name: prepare_cloud(scan.cloud) for scan in scans}
    for seed in seeds:
        for budget in BUDGETS:
            clicked = {s.name: draw_clicks(s.semantic, budget, np.random.default_rng(seed)) for s in scans}
            yield f'{budget}, seed {seed}', _means(scans, prepared, clicked, classes)


def _means(
    scans: Sequence[Scan],
    prepared: dict[str, PreparedCloud],
    clicked: dict[str, Int[np.ndarray, ' clicks']],
    classes: int,
) -> dict[str, float]:
    rules, began = WalkerRules(), time.perf_counter()
    annotated = {s.name: np.full(len(s.semantic), -1, dtype=np.int64) for s in scans}
    for scan in scans:
        annotated[scan.name][clicked[scan.name]] = scan.semantic[clicked[scan.name]]
    names = [scan.name for scan in scans]
    known = ScanKnowledge(
        names, lambda name: prepared[name].cloud, prepared.__getitem__, annotated.__getitem__, classes, rules, 0.0, 0
    )
    table = []
    for scan in scans:
        own, clicks = annotated[scan.name], clicked[scan.name]
        near = nearest_label(scan.cloud.xyz, clicks, scan.semantic[clicks])
        taught = known.beside(scan.name)
        alone, together = (
            propagate_prepared(prepared[scan.name], own, classes, rules, beside).semantic
            for beside in (Beside(), taught)
        )
        table.append([unlabelled_miou(said, scan.semantic, clicks) for said in (near, alone, together)])
    means = [round(float(value), 1) for value in np.mean(table, axis=0)]
    numbers = dict(zip(('nearest_miou', 'alone_miou', 'together_miou'), means, strict=True))
    return {'scans': float(len(scans)), **numbers, 'seconds': round(time.perf_counter() - began, 1)}
