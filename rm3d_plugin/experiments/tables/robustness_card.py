"""Robustness card: how alike a descriptor finds the same physical point after turning, dropping points and noise."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.descriptors import Descriptor, cosine_similarity
from rm3d_plugin.experiments.compared_descriptors import asked_descriptors
from rm3d_plugin.experiments.measured_descriptors import Entry, Measured, measure_table
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section
from rm3d_plugin.experiments.scenes import Collection, described_surface, turned
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.ops.turns import turn_about
from rm3d_plugin.structures import Descriptors, PointCloud
from rm3d_plugin.visualization.tables import LinePanel, draw_lines

Kind = Literal['turn about z', 'tilt', 'points dropped', 'noise']
LEVELS: dict[Kind, tuple[float, ...]] = {
    'turn about z': (20.0, 60.0, 180.0),
    'tilt': (20.0, 60.0, 180.0),
    'points dropped': (50.0, 80.0),
    'noise': (2.0, 5.0, 10.0),
}
UNITS: dict[Kind, str] = {'turn about z': 'degrees', 'tilt': 'degrees', 'points dropped': '%', 'noise': 'mm'}
COLUMNS: tuple[tuple[str, Kind, tuple[float, ...]], ...] = (  # heading, and of which changes it shows the worst
    ('turned about z', 'turn about z', LEVELS['turn about z']),
    ('tilted', 'tilt', LEVELS['tilt']),
    *((f'{level:g} % dropped', 'points dropped', (level,)) for level in LEVELS['points dropped']),
    *((f'noise {level:g} mm', 'noise', (level,)) for level in LEVELS['noise']),
)
LEAN = (1.0, 1.0, 0.0)  # axis of the tilt
COMPARED = 4000  # points of a scene that are compared, at most


class Changed(NamedTuple):
    """A scene after a change.

    Attributes:
        cloud: With normals and curvature estimated anew.
        rows: Number of each of its points in the scene before.
    """

    cloud: PointCloud
    rows: Int[np.ndarray, ' points']


class CardRow(NamedTuple):
    """How one descriptor stands one change on one collection; shares in [0, 1].

    Attributes:
        data: Title of the collection.
        descriptor: Type name.
        kind: Of change.
        level: In the unit of the kind.
        cosine: Mean similarity of a point before and after.
        own: Share of points that are more alike to themselves before than to a random other point before (ties: half).
            0.5 tells nothing, whatever the cosine.
        chance: Mean similarity of two random points before the change.
        valid: Share of points described before that are described after.
        points: Compared.
    """

    data: str
    descriptor: str
    kind: Kind
    level: float
    cosine: float
    own: float
    chance: float
    valid: float
    points: int


class Similarity(NamedTuple):
    """Of one scene, one row a compared point.

    Attributes:
        same: Cosine of the point before and after.
        other: Cosine of the point after and another one before.
        chance: Cosine of the point before and that other one before.
        lost: Points that are not described any more.
    """

    same: Float[np.ndarray, ' points']
    other: Float[np.ndarray, ' points']
    chance: Float[np.ndarray, ' points']
    lost: int


def change_scene(cloud: PointCloud, kind: Kind, level: float, rng: np.random.Generator) -> Changed:
    """Turn a scene, drop points of it or shake them; its surface is estimated anew, as in a scene never seen before.

    Args:
        cloud: The scene.
        kind: 'tilt' turns about a horizontal axis; 'points dropped' keeps a random rest; 'noise' is Gaussian, alike in
            all directions.
        level: Degrees, per cent dropped, or standard deviation in millimetres.
        rng: Draws the rest and the noise.
    """
    everything = np.arange(len(cloud))
    if kind in ('turn about z', 'tilt'):
        axis = (0.0, 0.0, 1.0) if kind == 'turn about z' else LEAN
        return Changed(turned(cloud, turn_about(axis, level)), everything)
    bare = replace(cloud, normals=None, curvature=None)
    if kind == 'noise':
        shaken = cloud.xyz + rng.normal(0.0, level / 1000.0, cloud.xyz.shape)
        return Changed(described_surface(replace(bare, xyz=shaken)), everything)
    rows = np.sort(rng.permutation(len(cloud))[: round(len(cloud) * (1 - level / 100))])
    return Changed(described_surface(bare.select(rows)), rows)


def compare(
    before: Descriptors, after: Descriptors, rows: Int[np.ndarray, ' points'], seed: Sequence[int]
) -> Similarity:
    """Cosines of the points that were described before, some thousands of them drawn at random.

    Args:
        before: Of the scene as it was.
        after: Of the changed scene.
        rows: Number of each changed point in the scene before.
        seed: Draws the points, and for each another one.
    """
    rng = np.random.default_rng(seed)
    there = rng.permutation(np.flatnonzero(before.valid[rows]))[:COMPARED]
    points = there[after.valid[there]]
    described = np.flatnonzero(before.valid)
    others = rng.choice(described, len(points)) if len(described) else points
    own = before.values[rows[points]]
    return Similarity(
        cosine_similarity(own, after.values[points]),
        cosine_similarity(before.values[others], after.values[points]),
        cosine_similarity(before.values[others], own),
        len(there) - len(points),
    )


class Change(NamedTuple):
    """One change of one scene; every descriptor sees the same ones.

    Attributes:
        kind: Of change.
        level: In the unit of the kind.
        scene: Number of the scene in its collection.
        before: The scene.
        after: What became of it.
    """

    kind: Kind
    level: float
    scene: int
    before: PointCloud
    after: Changed


def robustness_table(request: Request) -> FilledTable:
    """Measure every descriptor with its preset; what was measured is kept, descriptor by descriptor.

    Args:
        request: Its ``data`` are keys of :data:`rm3d_plugin.experiments.scenes.COLLECTIONS`; its seed draws what is
            dropped, the noise and the compared points.

    Raises:
        ConfigError: None of the data are there, or a descriptor is not among those that are compared.
    """

    def entry(name: str) -> Entry:
        return Entry(
            name,
            name,
            lambda part, collection, changes: measure_card(name, part, collection.title, changes, request.seed),
        )

    entries = [entry(name) for name in asked_descriptors(request)]
    return measure_table(Measured('robustness-card', CardRow, entries, change_scenes, fill_card), request)


def change_scenes(collection: Collection, seed: int) -> list[Change]:
    """Every change of every scene of a collection, scene by scene."""
    out = []
    for number, scene in enumerate(collection.scenes):
        for i, kind in enumerate(get_args(Kind)):
            for level in LEVELS[kind]:
                rng = np.random.default_rng([seed, number, i, int(level)])
                out.append(Change(kind, level, number, scene.cloud, change_scene(scene.cloud, kind, level, rng)))
    return out


def measure_card(
    name: str, part: Descriptor, data: str, changes: Callable[[], Sequence[Change]], seed: int
) -> list[CardRow]:
    """A descriptor under all changes; the scenes of a collection are taken together.

    Args:
        name: Type name of the descriptor.
        part: The descriptor.
        data: Title of the collection.
        changes: Makes the changes, or hands them out anew.
        seed: Draws the compared points.
    """
    found: dict[tuple[Kind, float], list[Similarity]] = {}
    before: dict[int, Descriptors] = {}
    for change in changes():
        if change.scene not in before:
            before = {change.scene: part.compute(change.before)}
        drawn = [seed, change.scene, get_args(Kind).index(change.kind)]
        similarity = compare(before[change.scene], part.compute(change.after.cloud), change.after.rows, drawn)
        found.setdefault((change.kind, change.level), []).append(similarity)
    return [_summary(data, name, *key, scenes) for key, scenes in found.items()]


def _summary(data: str, name: str, kind: Kind, level: float, scenes: Sequence[Similarity]) -> CardRow:
    same, other, chance = (
        np.concatenate([getattr(scene, field) for scene in scenes]) for field in Similarity._fields[:3]
    )
    lost = sum(scene.lost for scene in scenes)
    if not len(same):
        nothing = float('nan')
        return CardRow(data, name, kind, level, nothing, nothing, nothing, 0.0, 0)
    own = ((same > other) + 0.5 * (same == other)).mean()
    valid = len(same) / (len(same) + lost)
    return CardRow(data, name, kind, level, float(same.mean()), float(own), float(chance.mean()), valid, len(same))


def fill_card(rows: Sequence[CardRow], seed: int) -> FilledTable:
    """A section a collection; turns show their worst angle."""
    return FilledTable(
        title='Cosine of the same physical point before and after a change',
        notes=(
            'In brackets: per cent of points that are more alike to themselves than to a random other point; 50 tells '
            'nothing.',
            f'Turns: the worst of {", ".join(f"{level:g}" for level in LEVELS["tilt"])} degrees. Presets; normals '
            f'estimated anew; seed {seed}.',
        ),
        sections=tuple(_section(data, rows) for data in dict.fromkeys(row.data for row in rows)),
        records=tuple(row._asdict() for row in rows),
        figure=lambda: draw_lines(_panels(rows), 'cosine of the same point'),
    )


def _section(data: str, rows: Sequence[CardRow]) -> Section:
    own = [row for row in rows if row.data == data]
    return Section(
        title=data,
        columns=('descriptor', *(head for head, _, _ in COLUMNS), 'two random points'),
        rows=tuple(
            NamedRow(name, _cells([row for row in own if row.descriptor == name]))
            for name in dict.fromkeys(row.descriptor for row in own)
        ),
    )


def _cells(rows: Sequence[CardRow]) -> tuple[Cell, ...]:
    """Cells of one descriptor, whose rows are the changes."""
    worst = [_worst([row for row in rows if row.kind == kind and row.level in levels]) for _, kind, levels in COLUMNS]
    return (*worst, Cell(f'{rows[0].chance:.2f}', (rows[0].chance,)))


def _worst(rows: Sequence[CardRow]) -> Cell:
    row = min(rows, key=lambda row: row.cosine)
    return Cell(f'{row.cosine:.2f} ({100 * row.own:.0f})', (row.cosine, row.own))


def _panels(rows: Sequence[CardRow]) -> list[list[LinePanel]]:
    panels = []
    for data in dict.fromkeys(row.data for row in rows):
        own = [row for row in rows if row.data == data]
        panels.append([_panel(data, kind, [row for row in own if row.kind == kind]) for kind in LEVELS])
    return panels


def _panel(data: str, kind: Kind, rows: Sequence[CardRow]) -> LinePanel:
    levels = LEVELS[kind]
    lines: dict[str, Any] = {}
    for name in dict.fromkeys(row.descriptor for row in rows):
        lines[name] = [row.cosine for row in rows if row.descriptor == name]
    return LinePanel(f'{data}: {kind}', f'{kind}, {UNITS[kind]}', [f'{level:g}' for level in levels], lines)
