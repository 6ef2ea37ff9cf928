"""The paper's claim on its octree (18.2 times as fast on about three million points; it names no peer), measured."""

import argparse
from collections.abc import Sequence
from typing import Any, NamedTuple

from rm3d_plugin.experiments.benchmarks import octree
from rm3d_plugin.experiments.kept import kept_rows
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.visualization.tables import BarPanel, draw_bars

POINTS = 200_000  # where the request leaves them open; rm3d bench octree takes more
REPEATS, NEIGHBORS, LEAF_SIZE, QUERIES = 3, 30.0, 32, 100
CLAIM = (
    'The paper: 18.2 times as fast as an octree that it does not name, about 3e6 points, machine and radius not told.'
)


class OctreeRow(NamedTuple):
    """One program, or one setting of the rules.

    Attributes:
        kind: 'program' or 'rules'.
        name: Of it.
        seconds: Processor time: of all queries, sort and build included; of one query with rules, microseconds.
        times: As long as ours; octants that a query visits, with rules.
    """

    kind: str
    name: str
    seconds: float
    times: float


def octree_table(request: Request) -> FilledTable:
    """Radius search for all points of a room, ours beside other programs, and each rule apart; kept once measured.

    Args:
        request: Its ``points`` and ``out``.
    """
    points = request.points or POINTS
    path, asked = request.out / 'measured' / 'octree.json', {'points': points, 'repeats': REPEATS}
    return fill_octree(kept_rows(path, asked, OctreeRow, lambda: measure(points)), points)


def measure(points: int) -> list[OctreeRow]:
    """Run the benchmark on a room of so many points."""
    arguments = argparse.Namespace(
        points=points, neighbors=NEIGHBORS, order='random', leaf_size=LEAF_SIZE, rule_queries=QUERIES,
        skip=[], threads=1, repeats=REPEATS,
    )  # fmt: skip
    return rows_of(octree.run(arguments))


def rows_of(found: dict[str, Any]) -> list[OctreeRow]:
    """Rows from what the benchmark tells."""
    programs = [OctreeRow('program', name, own['cpu_s'], own['times_ours']) for name, own in found['seconds'].items()]
    rules = [OctreeRow('rules', name, own['microseconds'], own['visits']) for name, own in found['rules'].items()]
    return [*programs, *rules]


def fill_octree(rows: Sequence[OctreeRow], points: int) -> FilledTable:
    """A section for programs, one for rules."""
    programs = [row for row in rows if row.kind == 'program']
    return FilledTable(
        title=f'Radius search for all {points:,} points of a room, about {NEIGHBORS:g} neighbours, one thread',
        notes=(CLAIM, 'Processor time, median; sort and build included.'),
        sections=(
            _section('Programs', ('program', 'CPU s', 'times ours'), programs),
            _section(
                'Rules of our octree', ('rules', 'microseconds a query', 'octants a query'), rows[len(programs) :]
            ),
        ),
        records=tuple({'points': points, **row._asdict()} for row in rows),
        figure=lambda: draw_bars(
            [BarPanel('Programs', [row.name for row in programs], {'CPU s': [row.seconds for row in programs]})],
            'CPU s',
        ),
    )


def _section(title: str, columns: tuple[str, ...], rows: Sequence[OctreeRow]) -> Section:
    cells = (NamedRow(row.name, (_cell(row.seconds), _cell(row.times))) for row in rows)
    return Section(title, columns, tuple(cells))


def _cell(value: float) -> Cell:
    return Cell(f'{value:.3g}', (value,))
