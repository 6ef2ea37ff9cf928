"""From finished runs to a filled table: means over the seeds, ratios, what became of the labels."""

import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.compared import cpu_seconds, further_cells, further_heads, values_of
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section, bar_figure
from rm3d_plugin.experiments.runner import final_scores, run_folder, seeds_of
from rm3d_plugin.experiments.spec import Request, Row, Table
from rm3d_plugin.labeling import LabelSource
from rm3d_plugin.reporting.replay import source_of_run
from rm3d_plugin.storage import LabelStore

COVERAGE, PRECISION = 'points with a label', 'pseudo labels right'


class LabelShares(NamedTuple):
    """What became of the labels of a run, in percent; None where nothing was pseudo."""

    coverage: float
    precision: float | None


def fill_table(table: Table, request: Request) -> FilledTable:
    """Read the records of all runs of a table; they must be finished.

    Args:
        table: Which rows and scores.
        request: Folder and seeds.
    """
    records = [record for row in table.rows for record in _records(table, row, request)]
    ratio = [f'{list(table.scores)[-1]} / {table.reference}'] if table.reference is not None else []
    heads = (*table.scores, *ratio, *([COVERAGE, PRECISION] if table.labels else ()), *further_heads(table))
    rows = tuple(
        NamedRow(_title(row), _cells(table, row.name, records) + further_cells(table, row, records))
        for row in table.rows
    )
    section = Section('', ('trained on', *heads), rows)
    seeds = ', '.join(map(str, request.seeds))
    return FilledTable(
        title=f'{table.title}; mean of seeds {seeds} (lowest to highest)',
        notes=table.notes,
        sections=(section,),
        records=tuple(records),
        figure=lambda: bar_figure([section], len(table.scores), ', '.join(table.scores)),
    )


def label_shares(folder: Path) -> LabelShares:
    """Coverage and precision of the labels of a run's last round."""
    store = LabelStore(folder / 'labels')
    summary = store.summary(store.rounds()[-1])
    precision = summary['precision']
    return LabelShares(100 * summary['coverage'], None if precision is None else 100 * precision)


def label_source(folder: Path) -> LabelSource:
    """Scenes and truth of a run, with the budget that it learnt from.

    Args:
        folder: Its work directory.

    Raises:
        ConfigError: The data are gone, or the folder holds no run.
    """
    source, reason = source_of_run(folder / 'labels')
    if source is None:
        raise ConfigError(f'{folder}: the truth of its scenes is not there: {reason}')
    source.open(folder / 'labels', resume=True)
    return source


def mean_and_range(values: Sequence[float]) -> Cell:
    """Mean, lowest and highest; a dash for none."""
    if not values:
        return Cell('-')
    return Cell(f'{statistics.mean(values):.1f} ({min(values):.1f} to {max(values):.1f})', tuple(values))


def _title(row: Row) -> str:
    return row.name if row.seeds is None else f'{row.name} (seeds {", ".join(map(str, row.seeds))})'


def _records(table: Table, row: Row, request: Request) -> list[dict[str, float | str | None]]:
    """One record a seed."""
    found = []
    for seed in seeds_of(row, request):
        scores = final_scores(request.out, row, seed)
        record: dict[str, float | str | None] = {'row': row.name, 'config': row.config, 'seed': seed}
        record |= {head: scores[key] for head, key in table.scores.items()}
        if table.labels:
            record |= dict(zip((COVERAGE, PRECISION), label_shares(run_folder(request.out, row, seed)), strict=True))
        if table.cost:
            record |= cpu_seconds(run_folder(request.out, row, seed))._asdict()
        found.append(record)
    return found


def _cells(table: Table, name: str, records: Sequence[Mapping[str, float | str | None]]) -> tuple[Cell, ...]:
    cells = [mean_and_range(values_of(records, name, head)) for head in table.scores]
    last = list(table.scores)[-1]
    if table.reference is not None:
        whole = statistics.mean(values_of(records, table.reference, last))
        cells.append(Cell(f'{100 * statistics.mean(cells[-1].values) / whole:.0f} %' if whole else '-'))
    if table.labels:
        cells += [mean_and_range(values_of(records, name, head)) for head in (COVERAGE, PRECISION)]
    return tuple(cells)
