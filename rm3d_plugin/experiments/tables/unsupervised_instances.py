"""Instances without a single label (paper 4, METHOD 9): regions, merged by geometry and colour alone."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from rm3d_plugin.evaluation.functional.instance_ap import MIN_POINTS, InstanceAp, instance_ap
from rm3d_plugin.evaluation.functional.instance_overlap import InstanceOverlap, instance_overlap
from rm3d_plugin.experiments.compared_descriptors import build_descriptor
from rm3d_plugin.experiments.kept import kept_rows
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section, bar_figure
from rm3d_plugin.experiments.scenes import Collection, TableScene, load_collections
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.inference.oversegment import build_part
from rm3d_plugin.regions import MergeRules, RegionEvidence, merge
from rm3d_plugin.regions.prepare import PreparedScene, prepare_scene
from rm3d_plugin.registry import OVERSEGMENTERS

TAUS = (1.0, 1.25, 1.5, 1.6, 1.7, 1.8, 1.9)  # of Condition 3; 1.25 is the paper's
PAPER_AP50 = 46.8  # percent, ScanNet, "in a complete unsupervised manner"
HEADS = ('AP', 'AP50', 'AP25', 'groups a scene')
Groups = Int[np.ndarray, ' points']


class Partition(NamedTuple):
    """What one way of dividing scenes into instances reaches; percent."""

    name: str
    ap: float
    ap50: float
    ap25: float
    groups: float


def unsupervised_table(request: Request) -> FilledTable:
    """Regions as they are, merged with the paper's threshold, and with one that is chosen on other scenes.

    All regions count as one class of which everybody is sure, so Conditions 3 and 4 ask colour, extents, normals and
    descriptors alone, as the schedule weighs them in round 0. Walls, floors and ceilings are no instances, as in
    ScanNet's metric: what lies on them by more than half is left out. Nothing says how good a group is: all are scored
    alike.

    Raises:
        ConfigError: None of the data are there.
    """
    sections = [_section(collection, request) for collection in load_collections(request)]
    return FilledTable(
        'Instances without labels, percent, all classes as one',
        (
            'Scores are alike for all groups; stuff (without instances) and groups under '
            f'{MIN_POINTS} points are left out.',
            f'The paper reports an AP50 of {PAPER_AP50} on ScanNet.',
        ),
        tuple(sections),
        tuple(
            {
                'data': section.title,
                'partition': row.name,
                **dict(zip(HEADS, (c.values[0] for c in row.cells), strict=True)),
            }
            for section in sections
            for row in section.rows
        ),
        partial(bar_figure, sections, 3, 'percent'),
    )


def _section(collection: Collection, request: Request) -> Section:
    asked = {'scenes': request.scenes, 'points': request.points, 'taus': TAUS}
    path = request.out / 'measured' / f'unsupervised-instances_{collection.name}.json'
    rows = kept_rows(path, asked, Partition, partial(_measure, collection))
    cells = [NamedRow(row.name, tuple(Cell(f'{value:.1f}', (value,)) for value in row[1:])) for row in rows]
    return Section(collection.title, ('instances', *HEADS), tuple(cells))


def _measure(collection: Collection) -> list[Partition]:
    descriptor = build_descriptor('AdaptedPFH', collection)
    divider = build_part(OVERSEGMENTERS, 'RegionGrowing', collection.preset, {})

    def prepare(scenes: Sequence[TableScene]) -> list[PreparedScene]:
        return [prepare_scene(scene.cloud, descriptor, divider, name=scene.name) for scene in scenes]

    tuning, scenes = prepare(collection.tuning), prepare(collection.scenes)
    chosen = max(TAUS, key=lambda tau: _score(collection.tuning, tuning, partial(merged, tau=tau)).mean_ap50)
    ways: dict[str, Callable[[PreparedScene], Groups]] = {
        'regions': lambda scene: scene.regions.labels,
        "merged, the paper's threshold": partial(merged, tau=MergeRules().tau_merge),
        f'merged, threshold {chosen:g} (chosen on other scenes)': partial(merged, tau=chosen),
    }
    return [_partition(name, collection.scenes, scenes, way) for name, way in ways.items()]


def _partition(
    name: str, truths: Sequence[TableScene], scenes: Sequence[PreparedScene], way: Callable[[PreparedScene], Groups]
) -> Partition:
    found = _score(truths, scenes, way)
    count = float(np.mean([way(scene).max(initial=-1) + 1 for scene in scenes]))
    return Partition(name, 100 * found.mean_ap, 100 * found.mean_ap50, 100 * found.mean_ap25, count)


def merged(scene: PreparedScene, tau: float) -> Groups:
    """Group of each point, -1 = none: regions merged as in round 0, all of one class that everybody is sure of.

    Args:
        scene: Regions and their graph.
        tau: Condition 3's threshold, a sum of four similarities; Condition 4's moves with it.
    """
    rules = MergeRules()
    rules = replace(rules, tau_merge=tau, tau_seed=max(tau, rules.tau_seed))
    count = len(scene.regions)
    nobody = np.full(count, -1, dtype=np.int64)
    groups = merge(scene.graph, RegionEvidence(np.ones((count, 1)), nobody, nobody), rules, 0).group
    return np.append(groups, -1)[scene.regions.labels]


def overlap_of(scene: TableScene, groups: Groups) -> InstanceOverlap:
    """Groups against true instances, all of one class; points of stuff belong to none."""
    numbers = np.unique(groups[groups >= 0])
    masks = groups[None] == numbers[:, None]
    thing = (scene.objects >= 0) & (scene.semantic >= 0)
    alike = np.zeros(len(numbers), dtype=np.int64)
    return instance_overlap(
        np.where(thing, 0, -1), np.where(thing, scene.objects, -1), masks, alike, np.ones(len(numbers)), [0]
    )


def _score(
    truths: Sequence[TableScene], scenes: Sequence[PreparedScene], way: Callable[[PreparedScene], Groups]
) -> InstanceAp:
    overlaps = [overlap_of(truth, way(scene)) for truth, scene in zip(truths, scenes, strict=True)]
    return instance_ap(overlaps, [0], MIN_POINTS)
