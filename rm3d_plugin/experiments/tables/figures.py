"""Pictures of our own runs, after the paper's Figures 4 to 8: regions, merging, labels by round, their quality."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section
from rm3d_plugin.experiments.runner import Commands, run_folder, run_rows
from rm3d_plugin.experiments.scale import scaled_row
from rm3d_plugin.experiments.scenes import Collection, TableScene, load_collections
from rm3d_plugin.experiments.scores import label_source
from rm3d_plugin.experiments.spec import WHOLE, Request, Row, Scale
from rm3d_plugin.experiments.tables.paper_rows import AS_PAPER, DEFAULT, PAPER, descriptor_names, leaf_row
from rm3d_plugin.inference.oversegment import build_part
from rm3d_plugin.label_budgets import PointAmount, draw_points
from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label
from rm3d_plugin.regions.merge import RegionEvidence, merge
from rm3d_plugin.regions.prepare import PreparedScene, prepare_scene
from rm3d_plugin.regions.rules import MergeRules
from rm3d_plugin.registry import DESCRIPTORS, OVERSEGMENTERS
from rm3d_plugin.storage import LabelStore, write_bytes
from rm3d_plugin.visualization.bev import BevPanel, class_point_colors, draw_bev, span_of
from rm3d_plugin.visualization.palette import region_colors
from rm3d_plugin.visualization.tables import BarPanel, draw_bars

LEAF, SMALL = 'rm3d_ins_scannet_0p2pct', Scale(0.125)  # instances: their groups are the merged regions
SHOWN = ('AdaptedPFH', 'PFH', 'VCCS', 'Contrastive')  # of the paper's Figures 6 and 7; those that are registered
MARGIN = 0.3  # m around a scene
PICTURES = 'Pictures: figure_labels.png, figure_rooms.png, figure_streets.png.'
PERCENT = 0.2  # of the points of a scene, annotated
MAX_GAP = {'indoor': 0.1, 'lidar': 0.6}  # m, as in the configs
HEADS = {'coverage': 'points with a label, %', 'precision': 'pseudo labels right, %', 'offset_error': 'offset error, m'}


class Quality(NamedTuple):
    """Labels of one round of one method: shares in percent, metres; NaN where nothing is known."""

    method: str
    round: int
    coverage: float
    precision: float
    offset_error: float


class Merged(NamedTuple):
    """Regions and merged regions of a scene by one descriptor."""

    descriptor: str
    regions: Int[np.ndarray, ' points']
    groups: Int[np.ndarray, ' points']


def figures_table(request: Request, commands: Commands | None = None) -> FilledTable:
    """Train both strategies on a few demo rooms, merge the regions of one room and one street by descriptor, and draw.

    ``figure_labels.png``, ``figure_rooms.png``, ``figure_streets.png`` lie beside the table; its own PNG is of the
    quality of labels.

    Args:
        request: Its seed draws the labels; ``points`` of each scene are merged by descriptor.
        commands: What trains.
    """
    scale = SMALL if request.scale == WHOLE else request.scale
    rows = {name: scaled_row(row, scale) for name, row in method_rows().items()}
    run_rows(list(rows.values()), replace(request, seeds=(request.seed,)), commands)
    folders = {name: run_folder(request.out, row, request.seed) for name, row in rows.items()}
    write_bytes(request.out / 'figure_labels.png', draw_rounds(folders[PAPER]))
    few = replace(request, scenes=1, data=tuple(kind for kind in request.data if kind in ('rooms', 'streets')))
    for collection in load_collections(few):
        picture = draw_merging(collection, request.seed)
        write_bytes(request.out / f'figure_{collection.name}.png', picture)
    found = [quality for name, folder in folders.items() for quality in qualities(name, folder)]
    return fill_quality(found, notes=(f'Smaller than the demo: {scale}.', PICTURES))


def method_rows() -> dict[str, Row]:
    """What is trained for the pictures."""
    return {PAPER: leaf_row(PAPER, LEAF, AS_PAPER), DEFAULT: leaf_row(DEFAULT, LEAF)}


def draw_rounds(folder: Path) -> bytes:
    """The first training scene of a run: annotated points, labels of the first and last round, groups, truth.

    Args:
        folder: Work directory of a run on instances.
    """
    source, store = label_source(folder), LabelStore(folder / 'labels')
    scene, rounds = source.scene_ids[0], store.rounds()
    xyz, truth = source.load_cloud(0).xyz, source.truth(0)
    first, last = store.read(scene, rounds[0]), store.read(scene, rounds[-1])
    annotated = np.where(first.point_is_annotated, first.semantic, -1)
    assert truth is not None and truth.semantic is not None, 'draw_rounds: these scenes have labels'
    classes = {
        f'{int((annotated >= 0).sum())} annotated points': annotated,
        'labels of round 0': first.semantic,
        f'labels of round {rounds[-1]}': last.semantic,
        'truth': truth.semantic,
    }
    count = len(source.classes)
    panels = [BevPanel(title, xyz, class_point_colors(labels, count)) for title, labels in classes.items()]
    panels.insert(3, BevPanel('merged regions', xyz, region_colors(last.instance)))
    return draw_bev(panels, span_of(panels, MARGIN), width=2.6)


def draw_merging(collection: Collection, seed: int) -> bytes:
    """Regions of a scene before and after merging, by descriptor.

    Args:
        collection: Its first scene is drawn.
        seed: Of the annotated points.
    """
    scene = collection.scenes[0]
    panels = []
    for name in (name for name in SHOWN if name in descriptor_names()):
        merged = merge_scene(collection, scene, name, seed)
        for what, labels in (('regions', merged.regions), ('merged', merged.groups)):
            title = f'{name}\n{labels.max() + 1} {what}, {purity(labels, scene.semantic):.1f} % pure'
            panels.append(BevPanel(title, scene.cloud.xyz, region_colors(labels)))
    return draw_bev(panels, span_of(panels, MARGIN), width=2.6)


def merge_scene(collection: Collection, scene: TableScene, name: str, seed: int) -> Merged:
    """Divide a scene and merge its regions once (METHOD 6), the nearest annotated point in the network's place.

    Args:
        collection: Its presets.
        scene: Its points and truth.
        name: Of the descriptor.
        seed: Of the annotated points.
    """
    options = collection.options
    descriptor = build_part(DESCRIPTORS, name, collection.preset, options.get(name, {}))
    growing = build_part(OVERSEGMENTERS, 'RegionGrowing', collection.preset, options.get('RegionGrowing', {}))
    prepared = prepare_scene(scene.cloud, descriptor, growing, max_gap=MAX_GAP[collection.preset], name=scene.name)
    chosen = draw_points(scene.semantic, scene.objects, PointAmount(percent=PERCENT), np.random.default_rng(seed))
    said = nearest_label(scene.cloud.xyz, chosen, scene.semantic[chosen])
    result = merge(prepared.graph, _evidence(prepared, said, collection.classes), MergeRules(), 0)
    regions = prepared.regions.labels
    return Merged(name, regions, np.where(regions >= 0, np.append(result.group, -1)[regions], -1))


def purity(labels: Int[np.ndarray, ' points'], semantic: Int[np.ndarray, ' points']) -> float:
    """Percent of the points that are of the most frequent class of their region; points without either do not count.

    >>> purity(np.array([0, 0, 0, 1, -1]), np.array([2, 2, 3, 1, 1]))
    75.0
    """
    used = (labels >= 0) & (semantic >= 0)
    if not used.any():
        return math.nan
    counts = np.zeros((labels[used].max() + 1, semantic[used].max() + 1), dtype=np.int64)
    np.add.at(counts, (labels[used], semantic[used]), 1)
    return float(100 * counts.max(axis=1).sum() / used.sum())


def qualities(method: str, folder: Path) -> list[Quality]:
    """What the label store of a finished run says of each round."""
    store = LabelStore(folder / 'labels')
    return [quality_of(method, number, store.summary(number)) for number in store.rounds()]


def fill_quality(
    found: Sequence[Quality],
    title: str = 'Quality of labels by round and method: instances of demo rooms, 0.2 % of the points annotated',
    notes: tuple[str, ...] = (),
) -> FilledTable:
    """A section a method, a row a round; the picture has the last round of each.

    Args:
        found: Of all methods.
        title: One line.
        notes: Below the table.
    """
    methods = list(dict.fromkeys(quality.method for quality in found))
    last = [[quality for quality in found if quality.method == method][-1] for method in methods]
    return FilledTable(
        title=title,
        notes=notes,
        sections=tuple(_section(method, found) for method in methods),
        records=tuple(quality._asdict() for quality in found),
        figure=lambda: draw_bars(
            [BarPanel(head, methods, {head: [getattr(row, name) for row in last]}) for name, head in HEADS.items()],
            'last round',
        ),
    )


def _evidence(prepared: PreparedScene, said: Int[np.ndarray, ' points'], classes: int) -> RegionEvidence:
    """Shares of the classes among the points of each region, as if a network had told them."""
    labels, count = prepared.regions.labels, len(prepared.graph)
    used = (labels >= 0) & (said >= 0)
    shares = np.zeros((count, classes))
    np.add.at(shares, (labels[used], said[used]), 1.0)
    unknown = np.full(count, -1)
    return RegionEvidence(shares / np.maximum(shares.sum(axis=1, keepdims=True), 1.0), unknown, unknown)


def quality_of(method: str, number: int, summary: Mapping[str, float | None]) -> Quality:
    """What a record says of a round.

    Args:
        method: Name.
        number: The round.
        summary: ``coverage`` and ``precision``, in [0, 1], and ``offset_error``; None: not known.
    """
    coverage, precision, offset = (summary.get(name) for name in HEADS)
    share = math.nan if precision is None else 100 * precision
    return Quality(method, number, 100 * (coverage or 0.0), share, math.nan if offset is None else offset)


def _section(method: str, found: Sequence[Quality]) -> Section:
    rows = (
        NamedRow(str(quality.round), tuple(_cell(getattr(quality, name), name) for name in HEADS))
        for quality in found
        if quality.method == method
    )
    return Section(method, ('round', *HEADS.values()), tuple(rows))


def _cell(value: float, name: str) -> Cell:
    return Cell('-') if math.isnan(value) else Cell(f'{value:.{2 if name == "offset_error" else 1}f}', (value,))
