"""What a table of compared methods tells beside the scores: gains, here and elsewhere, and what a run cost."""

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rm3d_plugin.engine.hooks.pretraining_hook import RECORD
from rm3d_plugin.engine.round_times import total_seconds
from rm3d_plugin.experiments.render import Cell
from rm3d_plugin.experiments.spec import Row, Table
from rm3d_plugin.storage import read_json

Records = Sequence[Mapping[str, float | str | None]]
GAINS = ('gain', "paper's gain", "publication's gain", 'same sign')
COST = ('CPU s', 'CPU s of pre-training')


class CpuSeconds(NamedTuple):
    """Seconds of the processor that a run took.

    Attributes:
        cpu_seconds: Of training and of making labels; validation and evaluating labels are left out.
        pretraining_seconds: Of the pre-training that it took its weights from, which other runs may share.
    """

    cpu_seconds: float
    pretraining_seconds: float


def cpu_seconds(folder: Path) -> CpuSeconds:
    """Of a finished run, by what it noted."""
    before = folder / RECORD
    shared = float(read_json(before)['cpu_seconds']) if before.is_file() else 0.0
    return CpuSeconds(total_seconds(folder).cpu, shared)


def further_heads(table: Table) -> tuple[str, ...]:
    """Headings behind those of the scores."""
    return (*(GAINS if _tells_gains(table) else ()), *(COST if table.cost else ()))


def further_cells(table: Table, row: Row, records: Records) -> tuple[Cell, ...]:
    """The cells of a row under :func:`further_heads`."""
    cells: list[Cell] = list(_gains(table, row, records)) if _tells_gains(table) else []
    if table.cost:
        for head in CpuSeconds._fields:
            values = tuple(values_of(records, row.name, head))
            cells.append(Cell(f'{statistics.mean(values):.0f}', values) if any(values) else Cell('-'))
    return tuple(cells)


def values_of(records: Records, name: str, head: str) -> list[float]:
    """What was measured under a heading, one value a seed of a row."""
    return [value for record in records if record['row'] == name and isinstance(value := record[head], int | float)]


def _tells_gains(table: Table) -> bool:
    return any(row.against is not None for row in table.rows)


def _gains(table: Table, row: Row, records: Records) -> tuple[Cell, ...]:
    """Gain of the means in the last score, those of the paper and of the publication, and whether signs agree."""
    if row.against is None:
        return (Cell('-'),) * len(GAINS)
    last = list(table.scores)[-1]
    ours = statistics.mean(values_of(records, row.name, last)) - statistics.mean(values_of(records, row.against, last))
    elsewhere = (row.paper_gain, row.published_gain)
    told = [Cell('-') if gain is None else Cell(f'{gain:+.1f}', (gain,)) for gain in elsewhere]
    return (Cell(f'{ours:+.1f}', (ours,)), *told, Cell(agreement(ours, elsewhere)))


def agreement(ours: float, elsewhere: Sequence[float | None]) -> str:
    """Whether a gain has the sign of those elsewhere.

    >>> [agreement(1.0, gains) for gains in ((2.0, None), (2.0, -1.0), (None, None))]
    ['yes', 'no', '-']
    """
    known = [gain for gain in elsewhere if gain is not None]
    if not known:
        return '-'
    return 'yes' if all((gain > 0) == (ours > 0) for gain in known) else 'no'
