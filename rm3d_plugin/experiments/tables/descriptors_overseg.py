"""Table 1 of the paper: how well regions keep to objects, for each descriptor, as scanned and turned."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from rm3d_plugin.descriptors import Descriptor
from rm3d_plugin.evaluation.functional.boundary import boundary_scores
from rm3d_plugin.experiments.compared_descriptors import asked_descriptors, build_descriptor
from rm3d_plugin.experiments.measured_descriptors import Entry, Measured, measure_table
from rm3d_plugin.experiments.poses import HEADING, POSES, TITLES, Pose, pose_cell, posed
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section
from rm3d_plugin.experiments.scenes import Collection, TableScene
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.inference.oversegment import POINTS_PER_REGION, build_part
from rm3d_plugin.label_budgets import PointAmount, draw_points
from rm3d_plugin.oversegmentation import Oversegmenter
from rm3d_plugin.oversegmentation.cut_pursuit import load_solver
from rm3d_plugin.oversegmentation.region_growing import PRESETS as GROWING_PRESETS
from rm3d_plugin.oversegmentation.tuning import (
    Score,
    Tuning,
    bisect_count,
    score_regions,
    tune_options,
    tune_region_growing,
)
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors
from rm3d_plugin.visualization.tables import BarPanel, draw_bars

LABELLED_PERCENT = 0.2  # of the points of a tuning scene; the paper's budget for its Table 1
SIZES: dict[str, tuple[float, float]] = {'indoor': (0.1, 2.0), 'lidar': (0.6, 8.0)}  # m, VCCS' seed_size
VOXELS = {'indoor': 0.05, 'lidar': 0.3}  # m, VCCS' voxel_size
PRICES = (0.003, 30.0)  # CutPursuit's regularization
ZETAS = (0.015, 0.04)  # curvature differences that are tried; the first is the indoor preset's
STEPS = 5  # values of theta, seed_size or regularization that are tried
COUNTED = {'RegionGrowing': 'theta', 'VCCS': 'seed_size', 'CutPursuit': 'regularization'}  # larger: fewer regions
NEARBY = 4.0  # on a scene the count is met by values within this factor of the tuned one
SCORES = ('recall', 'precision', 'f1', 'oracle_miou')


class Method(NamedTuple):
    """A row of the table: what describes points, and what divides them."""

    title: str
    descriptor: str
    oversegmenter: str = 'RegionGrowing'
    options: Mapping[str, Any] = {}


DIVIDED = (
    Method('FPFH, VCCS divides', 'FPFH', 'VCCS'),
    Method('normals, VCCS divides', 'FPFH', 'VCCS', {'distance': 'pcl'}),
    Method('SuperpointGraph, CutPursuit divides', 'SuperpointGraph', 'CutPursuit'),
    Method('SupervisedSuperpoint, CutPursuit divides', 'SupervisedSuperpoint', 'CutPursuit', {'xyz_weight': 0.2}),
)


class OversegScores(NamedTuple):
    """What one method reaches on one scene in one pose; shares in [0, 1], CPU seconds."""

    data: str
    method: str
    pose: Pose
    scene: str
    recall: float
    precision: float
    f1: float
    oracle_miou: float
    oracle_accuracy: float
    regions: int
    describe_seconds: float
    divide_seconds: float
    points: int
    settings: str


@dataclass(frozen=True, eq=False)
class Parts:
    """A method with the numbers that it was tuned to.

    Attributes:
        descriptor: Describes points.
        divider: Makes the over-segmenter with some of its numbers changed.
        counted: Name of the one that makes regions fewer as it grows.
        tuning: Of all of them, on the tuning scenes.
    """

    descriptor: Descriptor
    divider: Callable[[Mapping[str, float]], Oversegmenter]
    counted: str
    tuning: Tuning


def asked_methods(request: Request) -> tuple[Method, ...]:
    """Region growing by each descriptor, and the methods with one of them that divide in their own way."""
    names = asked_descriptors(request)
    return (*(Method(name, name) for name in names), *(method for method in DIVIDED if method.descriptor in names))


def descriptor_table(request: Request) -> FilledTable:
    """Measure every method on every collection; what was measured is kept, method by method.

    Settings are tuned on the annotated labels of another scene, to one region for every 150 points; then the value that
    counts regions is set on each scene as scanned, without labels, so that counts are alike. Descriptors keep their
    presets. Seeds of region growing are not labelled points, so that geometry is measured alone.

    Args:
        request: Its ``data`` are keys of :data:`rm3d_plugin.experiments.scenes.COLLECTIONS`; its seed draws the
            annotated labels and the turns.

    Raises:
        ConfigError: None of the data are there, or a descriptor is not among those that are compared.
    """

    def entry(method: Method) -> Entry:
        return Entry(
            method.title,
            method.descriptor,
            lambda part, collection, shared: measure_method(method, collection, request.seed),
        )

    entries = [entry(method) for method in asked_methods(request) if _can_run(method, request.log)]
    return measure_table(
        Measured('descriptors-overseg', OversegScores, entries, lambda collection, seed: None, fill_overseg), request
    )


def measure_method(method: Method, collection: Collection, seed: int) -> list[OversegScores]:
    """Tune, then measure all scenes in each pose; all methods see the same labels and turns."""
    labels = [_annotated_labels(scene, [seed, number]) for number, scene in enumerate(collection.tuning)]
    parts = tune_method(method, collection, labels)
    scenes = enumerate(collection.scenes)
    return [row for number, scene in scenes for row in measure(method, parts, collection, scene, [seed, number])]


def tune_method(method: Method, collection: Collection, labels: Sequence[Int[np.ndarray, ' _points']]) -> Parts:
    """Find the settings of a method that give the wanted number of regions with the least conflicts."""
    descriptor = build_descriptor(method.descriptor, collection)
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
    return Parts(descriptor, build, COUNTED[method.oversegmenter], tuning)


def measure(
    method: Method, parts: Parts, collection: Collection, scene: TableScene, seed: Sequence[int]
) -> Iterator[OversegScores]:
    """Describe, divide and score a scene in each pose, on the graph of the scene as scanned."""
    options: Mapping[str, float] = parts.tuning.options
    for pose in POSES:
        cloud = posed(scene.cloud, pose, seed)
        start = time.process_time()
        described = parts.descriptor.compute(cloud)
        describing = time.process_time() - start
        if pose == 'original':
            options = options_for(parts, scene, described)
        start = time.process_time()
        regions = parts.divider(options).partition(cloud, described)
        dividing = time.process_time() - start
        found = boundary_scores(scene.cloud.xyz, scene.semantic, regions, collection.classes, scene.objects)
        settings = ', '.join(f'{name} {value:.3g}' for name, value in options.items())
        yield OversegScores(
            collection.title, method.title, pose, scene.name, found.recall, found.precision, found.f1,
            found.oracle_miou, found.oracle_accuracy, found.regions, describing, dividing, len(cloud), settings,
        )  # fmt: skip


def options_for(parts: Parts, scene: TableScene, described: Descriptors) -> dict[str, float]:
    """The tuned options, the counted one set so that the scene has one region for 150 points, or nearly so."""
    target = max(1, round(len(scene.cloud) / POINTS_PER_REGION))
    tuned, counts = parts.tuning.options, dict[float, int]()

    def regions_at(value: float) -> int:
        divided = parts.divider({**tuned, parts.counted: value}).partition(scene.cloud, described)
        counts[value] = len(np.unique(divided[divided >= 0]))
        return counts[value]

    middle = tuned[parts.counted]
    bisect_count(regions_at, middle / NEARBY, middle * NEARBY, target, STEPS)
    nearest = min(counts, key=lambda value: abs(np.log(max(counts[value], 1) / target)))
    return {**tuned, parts.counted: nearest}


def fill_overseg(rows: Sequence[OversegScores], seed: int) -> FilledTable:
    """A section a collection; cells hold original / turned about z / turned freely, in percent."""
    return FilledTable(
        title=f'Regions by descriptor, in percent: {HEADING}',
        notes=(
            f'Mean ± standard deviation over the scenes. Turned by 0 to 180 degrees; seed {seed}. Boundaries on the '
            '5-nn graph, one edge off allowed.',
            f'Tuned on the annotated labels ({LABELLED_PERCENT} %) of another scene; on each scene as scanned to one '
            f'region for {POINTS_PER_REGION} points.',
            'CPU seconds of a scene as scanned: describe + divide.',
        ),
        sections=tuple(_section(data, rows) for data in dict.fromkeys(row.data for row in rows)),
        records=tuple(row._asdict() for row in rows),
        figure=lambda: draw_bars(_panels(rows), 'boundary F1, percent'),
    )


def _section(data: str, rows: Sequence[OversegScores]) -> Section:
    own = [row for row in rows if row.data == data]
    points = {row.scene: row.points for row in own}
    return Section(
        title=f'{data}: {len(points)} scenes, {sum(points.values())} points',
        columns=('descriptor', 'recall', 'precision', 'F1', 'oracle mIoU', 'regions', 'CPU s'),
        rows=tuple(
            NamedRow(method, _cells([row for row in own if row.method == method]))
            for method in dict.fromkeys(row.method for row in own)
        ),
    )


def _cells(rows: Sequence[OversegScores]) -> tuple[Cell, ...]:
    """Cells of one method, whose rows are the scenes in each pose."""
    scanned = [row for row in rows if row.pose == 'original']
    seconds = [float(np.mean([getattr(row, f'{part}_seconds') for row in scanned])) for part in ('describe', 'divide')]
    return (
        *(pose_cell(_by_pose(rows, name, 100)) for name in SCORES),
        pose_cell(_by_pose(rows, 'regions'), '.0f'),
        Cell(' + '.join(f'{part:.2f}' for part in seconds), tuple(seconds)),
    )


def _by_pose(rows: Sequence[OversegScores], name: str, factor: float = 1) -> dict[Pose, list[float]]:
    return {pose: [factor * getattr(row, name) for row in rows if row.pose == pose] for pose in POSES}


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


def _panels(rows: Sequence[OversegScores]) -> list[BarPanel]:
    panels = []
    for data in dict.fromkeys(row.data for row in rows):
        own = [row for row in rows if row.data == data]
        names = list(dict.fromkeys(row.method for row in own))
        found = [_by_pose([row for row in own if row.method == name], 'f1', 100) for name in names]
        bars = {TITLES[pose]: [float(np.mean(values[pose])) for values in found] for pose in POSES}
        panels.append(BarPanel(data, names, bars))
    return panels
