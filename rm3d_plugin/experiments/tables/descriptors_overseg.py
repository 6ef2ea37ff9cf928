"""Table 1 of the paper: how well regions keep to objects, for each descriptor, as scanned and turned."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from operator import add
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Int

from rm3d_plugin.descriptors import Descriptor
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.evaluation.functional.boundary import BoundaryCounts, boundary_counts, scores_of
from rm3d_plugin.experiments.kept import kept_rows, scenes_asked
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section, save
from rm3d_plugin.experiments.scenes import Collection, TableScene, load_collections, random_turn, turned
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.inference.oversegment import POINTS_PER_REGION, build_part
from rm3d_plugin.label_budgets import PointAmount, draw_points
from rm3d_plugin.oversegmentation import Oversegmenter
from rm3d_plugin.oversegmentation.cut_pursuit import load_solver
from rm3d_plugin.oversegmentation.region_growing import PRESETS as GROWING_PRESETS
from rm3d_plugin.oversegmentation.tuning import (
    Score,
    Tuning,
    score_regions,
    tune_options,
    tune_region_growing,
)
from rm3d_plugin.registry import DESCRIPTORS, OVERSEGMENTERS
from rm3d_plugin.visualization.tables import BarPanel, draw_bars

Pose = Literal['original', 'z', 'so3']
POSES: tuple[Pose, ...] = get_args(Pose)
LABELLED_PERCENT = 0.2  # of the points of a tuning scene; the paper's budget for its Table 1
SIZES: dict[str, tuple[float, float]] = {'indoor': (0.1, 2.0), 'lidar': (0.6, 8.0)}  # m, VCCS' seed_size
VOXELS = {'indoor': 0.05, 'lidar': 0.3}  # m, VCCS' voxel_size
PRICES = (0.003, 30.0)  # CutPursuit's regularization
ZETAS = (0.015, 0.04)  # curvature differences that are tried; the first is the indoor preset's
STEPS = 5  # values of theta, seed_size or regularization that are tried


class Method(NamedTuple):
    """A row of the table: what describes points, and what divides them."""

    title: str
    descriptor: str
    oversegmenter: str = 'RegionGrowing'
    options: Mapping[str, Any] = {}


METHODS = (
    Method('VisualSimilarity', 'VisualSimilarity'),
    Method('HKS', 'HKS'),
    Method('SIHKS', 'SIHKS'),
    Method('FPFH', 'FPFH'),
    Method('WKS', 'WKS'),
    Method('SHOT', 'SHOT'),
    Method('VCCS', 'VCCS'),
    Method('SuperpointGraph', 'SuperpointGraph'),
    Method('PFH', 'PFH'),
    Method('AdaptedPFH', 'AdaptedPFH'),
    Method('FPFH, VCCS divides', 'FPFH', 'VCCS'),
    Method('normals, VCCS divides', 'FPFH', 'VCCS', {'distance': 'pcl'}),
    Method('SuperpointGraph, CutPursuit divides', 'SuperpointGraph', 'CutPursuit'),
)


class OversegScores(NamedTuple):
    """What one method reaches on one collection in one pose; shares in [0, 1], CPU seconds and regions a scene."""

    data: str
    method: str
    pose: Pose
    recall: float
    precision: float
    f1: float
    oracle_miou: float
    oracle_accuracy: float
    regions: float
    describe_seconds: float
    divide_seconds: float
    scenes: int
    points: int
    settings: str


@dataclass(frozen=True, eq=False)
class Parts:
    """A method with the numbers that it was tuned to."""

    descriptor: Descriptor
    oversegmenter: Oversegmenter
    tuning: Tuning


def descriptor_table(request: Request, methods: Sequence[Method] = METHODS) -> FilledTable:
    """Measure every method on every collection; measured collections are kept.

    Settings are tuned on the annotated labels of another scene, to one region for every 150 points; the descriptors
    keep their presets. Seeds of region growing are not labelled points, so that geometry is measured alone.

    Args:
        request: Its ``data`` are keys of :data:`rm3d_plugin.experiments.scenes.COLLECTIONS`; its seed draws the
            annotated labels and the turns.
        methods: Rows.

    Raises:
        ConfigError: None of the data are there.
    """
    rows: list[OversegScores] = []
    methods = [method for method in methods if _can_run(method, request.log)]
    asked = scenes_asked(request, [method.title for method in methods])
    for collection in load_collections(request):
        rows += kept_rows(
            request.out / 'measured' / f'descriptors-overseg_{collection.name}.json',
            asked,
            OversegScores,
            partial(measure_collection, collection, methods, request.seed, request.log),
        )
        save(fill_overseg(rows, request.seed), request.out, 'descriptors-overseg')
    if not rows:
        raise ConfigError(f'nothing to measure: none of {", ".join(request.data)} is there')
    return fill_overseg(rows, request.seed)


def measure_collection(
    collection: Collection, methods: Sequence[Method], seed: int, log: Callable[[str], None] = print
) -> list[OversegScores]:
    """Tune, then measure, each method in each pose; all methods see the same labels and turns."""
    labels = [_annotated_labels(scene, [seed, number]) for number, scene in enumerate(collection.tuning)]
    posed = {pose: [_posed(scene, pose, seed, i) for i, scene in enumerate(collection.scenes)] for pose in POSES}
    rows = []
    for method in methods:
        start = time.process_time()
        parts = tune_method(method, collection, labels)
        rows += [measure(method, parts, collection, posed[pose], pose) for pose in POSES]
        spent = time.process_time() - start
        f1 = _percent_cell([row.f1 for row in rows[-3:]]).text
        log(f'{collection.title}: {method.title}: F1 {f1}, {spent:.0f} CPU s')
    return rows


def tune_method(method: Method, collection: Collection, labels: Sequence[Int[np.ndarray, ' _points']]) -> Parts:
    """Find the settings of a method that give the wanted number of regions with the least conflicts."""
    options = collection.options
    descriptor = build_part(DESCRIPTORS, method.descriptor, collection.preset, options.get(method.descriptor, {}))
    clouds = [scene.cloud for scene in collection.tuning]
    described = [descriptor.compute(cloud) for cloud in clouds]
    target = max(1, round(sum(map(len, clouds)) / POINTS_PER_REGION))
    fixed = _fixed_options(method, collection)

    def build(tuned: Mapping[str, float]) -> Oversegmenter:
        part: Oversegmenter = build_part(OVERSEGMENTERS, method.oversegmenter, None, {**fixed, **tuned})
        return part

    def score_of(tuned: Mapping[str, float]) -> Score:
        part = build(tuned)
        found = [
            score_regions(part.partition(*scene[:2]), scene[2]) for scene in zip(clouds, described, labels, strict=True)
        ]
        return Score(*np.sum(found, axis=0).tolist())

    if method.oversegmenter == 'RegionGrowing':
        tuning = tune_region_growing(clouds, described, labels, target, fixed, ZETAS, steps=STEPS)
    elif method.oversegmenter == 'VCCS':
        tuning = tune_options(score_of, 'seed_size', SIZES[collection.preset], target, steps=STEPS)
    else:
        tuning = tune_options(score_of, 'regularization', PRICES, target, steps=STEPS)
    return Parts(descriptor, build(tuning.options), tuning)


def measure(method: Method, parts: Parts, collection: Collection, clouds: Sequence[Any], pose: Pose) -> OversegScores:
    """Describe, divide and score all scenes of a collection in one pose, on the graph of the scenes as scanned."""
    counts: list[BoundaryCounts] = []
    describing = dividing = 0.0
    for scene, cloud in zip(collection.scenes, clouds, strict=True):
        start = time.process_time()
        described = parts.descriptor.compute(cloud)
        middle = time.process_time()
        regions = parts.oversegmenter.partition(cloud, described)
        describing, dividing = describing + middle - start, dividing + time.process_time() - middle
        counts.append(boundary_counts(scene.cloud.xyz, scene.semantic, regions, collection.classes, scene.objects))
    scores, number = scores_of(reduce(add, counts)), len(collection.scenes)
    settings = ', '.join(f'{name} {value:.3g}' for name, value in parts.tuning.options.items())
    points = sum(len(scene.cloud) for scene in collection.scenes)
    return OversegScores(
        collection.title, method.title, pose, scores.recall, scores.precision, scores.f1, scores.oracle_miou,
        scores.oracle_accuracy, scores.regions / number, describing / number, dividing / number, number, points,
        settings,
    )  # fmt: skip


def fill_overseg(rows: Sequence[OversegScores], seed: int) -> FilledTable:
    """A section a collection; cells hold original / turned about z / turned freely, in percent."""
    return FilledTable(
        title='Regions by descriptor, in percent: as scanned / turned about z / turned about a random axis',
        notes=(
            f'Turned by 0 to 180 degrees; seed {seed}. Boundaries on the 5-nn graph, one edge off allowed.',
            f'Tuned on the annotated labels ({LABELLED_PERCENT} %) of another scene to one region for '
            f'{POINTS_PER_REGION} points.',
            'CPU seconds of a scene as scanned: describe + divide.',
        ),
        sections=tuple(_section(data, rows) for data in dict.fromkeys(row.data for row in rows)),
        records=tuple(row._asdict() for row in rows),
        figure=lambda: draw_bars(_panels(rows), 'boundary F1, percent'),
    )


def _section(data: str, rows: Sequence[OversegScores]) -> Section:
    own = [row for row in rows if row.data == data]
    return Section(
        title=f'{data}: {own[0].scenes} scenes, {own[0].points} points',
        columns=('descriptor', 'recall', 'precision', 'F1', 'oracle mIoU', 'regions', 'CPU s', 'settings'),
        rows=tuple(
            NamedRow(method, _cells([row for row in own if row.method == method]))
            for method in dict.fromkeys(row.method for row in own)
        ),
    )


def _cells(poses: Sequence[OversegScores]) -> tuple[Cell, ...]:
    """Cells of one method, whose rows are its poses."""
    scores = [
        _percent_cell([getattr(row, name) for row in poses]) for name in ('recall', 'precision', 'f1', 'oracle_miou')
    ]
    regions = Cell(' / '.join(f'{row.regions:.0f}' for row in poses), tuple(row.regions for row in poses))
    seconds = Cell(
        f'{poses[0].describe_seconds:.2f} + {poses[0].divide_seconds:.2f}',
        (poses[0].describe_seconds, poses[0].divide_seconds),
    )
    return (*scores, regions, seconds, Cell(poses[0].settings))


def _fixed_options(method: Method, collection: Collection) -> dict[str, Any]:
    """Arguments of a method's over-segmenter that are not tuned; ``distance`` of VCCS, say."""
    name = method.oversegmenter
    if name == 'VCCS':
        return {'voxel_size': VOXELS[collection.preset], **method.options}
    presets = GROWING_PRESETS[collection.preset] if name == 'RegionGrowing' else {}
    return {**presets, **collection.options.get(name, {}), **method.options}


def _can_run(method: Method, log: Callable[[str], None]) -> bool:
    if method.oversegmenter != 'CutPursuit':
        return True
    try:
        load_solver()
    except ImportError as error:
        log(f'{method.title}: left out: {error}')
        return False
    return True


def _annotated_labels(scene: TableScene, seed: Sequence[int]) -> Int[np.ndarray, ' points']:
    chosen = draw_points(
        scene.semantic, scene.objects, PointAmount(percent=LABELLED_PERCENT), np.random.default_rng(seed)
    )
    labels = np.full(len(scene.semantic), -1, dtype=np.int64)
    labels[chosen] = scene.semantic[chosen]
    return labels


def _posed(scene: TableScene, pose: Pose, seed: int, number: int) -> Any:
    if pose == 'original':
        return scene.cloud
    rng = np.random.default_rng([seed, number, POSES.index(pose)])
    return turned(scene.cloud, random_turn(pose, rng))


def _percent_cell(shares: Sequence[float]) -> Cell:
    percent = tuple(100 * share for share in shares)
    return Cell(' / '.join(f'{value:.1f}' for value in percent), percent)


def _panels(rows: Sequence[OversegScores]) -> list[BarPanel]:
    titles = {'original': 'as scanned', 'z': 'turned about z', 'so3': 'turned about a random axis'}
    panels = []
    for data in dict.fromkeys(row.data for row in rows):
        own = [row for row in rows if row.data == data]
        names = list(dict.fromkeys(row.method for row in own))
        bars = {titles[pose]: [100 * row.f1 for row in own if row.pose == pose] for pose in POSES}
        panels.append(BarPanel(data, names, bars))
    return panels
