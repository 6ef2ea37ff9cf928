"""How well descriptors find the same place in two scans, and tell objects apart; as scanned and turned."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from rm3d_plugin.descriptors import Descriptor
from rm3d_plugin.evaluation.functional.matching import (
    LEAST_INLIERS,
    feature_match_recall,
    inlier_ratio,
    most_similar,
    motion_rmse,
    same_object_auc,
)
from rm3d_plugin.experiments.compared_descriptors import asked_descriptors
from rm3d_plugin.experiments.measured_descriptors import Entry, Measured, measure_table
from rm3d_plugin.experiments.poses import HEADING, POSES, TITLES, Pose, pose_cell, posed
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section
from rm3d_plugin.experiments.scan_pairs import INLIER, REGISTERED, ScanPair, cut_pair, length_unit, true_places
from rm3d_plugin.experiments.scenes import Collection, TableScene
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.inference.oversegment import build_part
from rm3d_plugin.ops.rigid_fit import ransac_rigid
from rm3d_plugin.ops.segment import segment_majority, segment_mean
from rm3d_plugin.oversegmentation import Oversegmenter
from rm3d_plugin.regions.graph import keep_nearest, touching_regions
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud, Regions
from rm3d_plugin.visualization.tables import BarPanel, draw_bars

PAIRS = 5  # cut from each scene
KEY_POINTS = 1000  # of the source, matched with all points of the target
PATCHES = {  # supervoxels by normals and places alone, the same for every descriptor; metres
    'indoor': {'voxel_size': 0.05, 'seed_size': 0.3},
    'lidar': {'voxel_size': 0.3, 'seed_size': 1.8},
}
REGION_NEIGHBORS = 8  # adjacent regions that each is compared with


class MatchingScores(NamedTuple):
    """What one descriptor reaches on one scene in one pose; shares in [0, 1].

    Attributes:
        data: Title of the collection.
        descriptor: Type name.
        pose: Of the second scan of each pair, and of the scene whose regions are compared.
        scene: Name.
        match_recall: Share of pairs with more than 5 % right matches.
        inlier_ratio: Mean share of right matches.
        registration_recall: Share of pairs that RANSAC brings together.
        auc: Of the similarity of adjacent regions: of one object, or of two.
        described: Share of the key points that the descriptor can describe.
        seconds: CPU seconds for 10,000 points.
        pairs: How many.
        within: Metres that a right match may be off.
    """

    data: str
    descriptor: str
    pose: Pose
    scene: str
    match_recall: float
    inlier_ratio: float
    registration_recall: float
    auc: float
    described: float
    seconds: float
    pairs: int
    within: float


class Patches(NamedTuple):
    """A partition of a scene that depends on no descriptor.

    Attributes:
        regions: Of the points.
        objects: Most frequent object of each region, -1 = not annotated.
        edges: Adjacent regions.
    """

    regions: Regions
    objects: Int[np.ndarray, ' regions']
    edges: Int[np.ndarray, 'edges 2']


class Trial(NamedTuple):
    """All that descriptors are compared on in one scene."""

    name: str
    clouds: dict[Pose, PointCloud]
    patches: Patches
    pairs: tuple[ScanPair, ...]


class PairScores(NamedTuple):
    """Of one descriptor on one pair of scans."""

    inliers: float
    registered: bool
    described: float


def matching_table(request: Request) -> FilledTable:
    """Measure every descriptor with its preset; what was measured is kept, descriptor by descriptor.

    Args:
        request: Its ``data`` are keys of :data:`rm3d_plugin.experiments.scenes.COLLECTIONS`; its seed draws the pairs,
            key points and turns.

    Raises:
        ConfigError: None of the data are there, or a descriptor is not among those that are compared.
    """

    def entry(name: str) -> Entry:
        return Entry(
            name,
            name,
            lambda part, collection, trials: measure(name, part, collection.title, trials, request.seed),
        )

    entries = [entry(name) for name in asked_descriptors(request)]
    return measure_table(Measured('descriptors-matching', MatchingScores, entries, make_trials, fill_matching), request)


def make_trials(collection: Collection, seed: int) -> list[Trial]:
    """Pairs, poses and patches of every scene; all descriptors see the same."""
    return [
        Trial(
            scene.name,
            {pose: posed(scene.cloud, pose, [seed, number]) for pose in POSES},
            make_patches(scene, collection),
            tuple(
                cut_pair(scene.cloud, length_unit(scene.cloud, collection.preset), (seed, number, pair))
                for pair in range(PAIRS)
            ),
        )
        for number, scene in enumerate(collection.scenes)
    ]


def make_patches(scene: TableScene, collection: Collection) -> Patches:
    """Supervoxels of a scene with their objects."""
    options = {**PATCHES[collection.preset], 'distance': 'pcl'}
    divider: Oversegmenter = build_part(OVERSEGMENTERS, 'VCCS', None, options)
    regions = divider.segment(scene.cloud, Descriptors(np.zeros((len(scene.cloud), 1), np.float32), _all(scene)))
    numbers = np.unique(scene.objects, return_inverse=True)[1].reshape(-1)
    known = np.where(scene.semantic >= 0, numbers, -1)
    edges = keep_nearest(touching_regions(scene.cloud.xyz, regions), len(regions), REGION_NEIGHBORS)
    return Patches(regions, segment_majority(known, regions.labels, len(regions)), edges)


def measure(
    name: str, part: Descriptor, data: str, trials: Callable[[], Sequence[Trial]], seed: int
) -> list[MatchingScores]:
    """All scenes in each pose.

    Args:
        name: Type name of the descriptor.
        part: The descriptor.
        data: Title of the collection.
        trials: Makes what is measured, or hands it out anew.
        seed: Draws key points and the triples of RANSAC.
    """
    return [row for trial in trials() for row in _measure_trial(name, part, data, trial, seed)]


def _measure_trial(name: str, part: Descriptor, data: str, trial: Trial, seed: int) -> Iterator[MatchingScores]:
    sources = [part.compute(pair.source) for pair in trial.pairs]
    for pose in POSES:
        start = time.process_time()
        targets = [part.compute(pair.targets[pose]) for pair in trial.pairs]
        seconds = time.process_time() - start
        found = [
            score_pair(pair, pose, ends, [seed, number])
            for number, (pair, *ends) in enumerate(zip(trial.pairs, sources, targets, strict=True))
        ]
        yield MatchingScores(
            data,
            name,
            pose,
            trial.name,
            feature_match_recall([pair.inliers for pair in found]),
            float(np.mean([pair.inliers for pair in found])),
            float(np.mean([pair.registered for pair in found])),
            region_auc(part.compute(trial.clouds[pose]), trial.patches),
            float(np.mean([pair.described for pair in found])),
            1e4 * seconds / sum(map(len, targets)),
            len(found),
            INLIER * trial.pairs[0].unit,
        )


def score_pair(pair: ScanPair, pose: Pose, ends: Sequence[Descriptors], seed: Sequence[int]) -> PairScores:
    """Match key points of the source with the target, and register by the matches.

    Args:
        pair: The scans.
        pose: Of the target.
        ends: Descriptors of source and target.
        seed: Draws key points and the triples of RANSAC.
    """
    rng = np.random.default_rng(seed)
    drawn = rng.permutation(len(pair.source))[:KEY_POINTS]
    keys, there = drawn[ends[0].valid[drawn]], np.flatnonzero(ends[1].valid)
    described = len(keys) / len(drawn)
    if len(keys) < 3 or not len(there):
        return PairScores(0.0, False, described)
    matched = there[most_similar(ends[0].values[keys], ends[1].values[there])]
    found = pair.targets[pose].xyz[matched].astype(np.float64)
    within = INLIER * pair.unit
    motion = ransac_rigid(pair.source.xyz[keys].astype(np.float64), found, within, rng)
    error = motion_rmse(pair.source.xyz[pair.shared], motion, pair.motions[pose])
    inliers = inlier_ratio(found, true_places(pair, pose)[keys], within)
    return PairScores(inliers, error < REGISTERED * pair.unit, described)


def region_auc(described: Descriptors, patches: Patches) -> float:
    """AUC of the cosine of region means; points that are not described do not count."""
    labels = np.where(described.valid, patches.regions.labels, -1)
    means = segment_mean(described.values, labels, len(patches.regions))
    return same_object_auc(means, patches.objects, patches.edges)


def fill_matching(rows: Sequence[MatchingScores], seed: int) -> FilledTable:
    """A section a collection; cells hold the poses."""
    return FilledTable(
        title=f'Matching by descriptor, in percent: {HEADING}',
        notes=(
            f'Mean ± standard deviation over the scenes. Pairs: two cuts of a scene, 30 to 70 % overlap, noise, random '
            f'points of each; seed {seed}.',
            f'Match recall: pairs with more than {100 * LEAST_INLIERS:g} % of {KEY_POINTS} nearest descriptors within '
            '10 cm of the true place; lidar: within four times the median point spacing.',
            'Registration recall: RANSAC ends within 20 cm (lidar: eight spacings; RMSE over the overlap). Region AUC: '
            'adjacent supervoxels of one object are more alike than of two.',
        ),
        sections=tuple(_section(data, rows) for data in dict.fromkeys(row.data for row in rows)),
        records=tuple(row._asdict() for row in rows),
        figure=lambda: draw_bars(_panels(rows), 'region AUC, percent'),
    )


def _section(data: str, rows: Sequence[MatchingScores]) -> Section:
    own = [row for row in rows if row.data == data]
    pairs = {row.scene: row.pairs for row in own}
    return Section(
        title=f'{data}: {len(pairs)} scenes, {sum(pairs.values())} pairs, matches within {own[0].within:.2f} m',
        columns=(
            'descriptor',
            'match recall',
            'inlier ratio',
            'registration recall',
            'region AUC',
            'described',
            's / 10k',
        ),
        rows=tuple(
            NamedRow(name, _cells([row for row in own if row.descriptor == name]))
            for name in dict.fromkeys(row.descriptor for row in own)
        ),
    )


def _cells(rows: Sequence[MatchingScores]) -> tuple[Cell, ...]:
    """Cells of one descriptor, whose rows are the scenes in each pose."""
    names = ('match_recall', 'inlier_ratio', 'registration_recall', 'auc')
    scores = [pose_cell(_by_pose(rows, name)) for name in names]
    described, seconds = (float(np.mean([getattr(row, name) for row in rows])) for name in ('described', 'seconds'))
    return (*scores, Cell(f'{100 * described:.0f}', (100 * described,)), Cell(f'{seconds:.2f}', (seconds,)))


def _by_pose(rows: Sequence[MatchingScores], name: str) -> dict[Pose, list[float]]:
    return {pose: [100 * getattr(row, name) for row in rows if row.pose == pose] for pose in POSES}


def _panels(rows: Sequence[MatchingScores]) -> list[BarPanel]:
    panels = []
    for data in dict.fromkeys(row.data for row in rows):
        own = [row for row in rows if row.data == data]
        names = list(dict.fromkeys(row.descriptor for row in own))
        found = [_by_pose([row for row in own if row.descriptor == name], 'auc') for name in names]
        bars = {TITLES[pose]: [float(np.mean(values[pose])) for values in found] for pose in POSES}
        panels.append(BarPanel(data, names, bars))
    return panels


def _all(scene: TableScene) -> np.ndarray:
    return np.ones(len(scene.cloud), dtype=np.bool_)
