"""Makes a table, or all: trains or measures what it needs, and writes it in every format."""

import datetime
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from rm3d_plugin import __version__
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.benchmarks.measure import machine
from rm3d_plugin.experiments.compare import fill_paper_table
from rm3d_plugin.experiments.render import FilledTable, save, to_markdown
from rm3d_plugin.experiments.runner import Commands, duration, plan, run_rows
from rm3d_plugin.experiments.scale import choose_scale, scaled_request, scaled_table
from rm3d_plugin.experiments.scores import fill_table
from rm3d_plugin.experiments.spec import AnyTable, MeasuredTable, Request, Table
from rm3d_plugin.experiments.tables import ALL, TABLES
from rm3d_plugin.storage import write_text


def make_table(
    name: str, request: Request, commands: Commands | None = None, minutes: float | None = None
) -> FilledTable:
    """Make a table; ``out/NAME.md``, ``.csv``, ``.json``, ``.tex`` and ``.png`` hold it.

    Args:
        name: Key of :data:`rm3d_plugin.experiments.tables.TABLES`.
        request: Where, with which seeds, options and scenes.
        commands: What trains and tests.
        minutes: On the clock, kept by fewer scenes, epochs, parts, seeds and rows; None: as they are.

    Raises:
        ConfigError: There is no such table; a run failed or was made with other options; data are missing.
    """
    if name not in TABLES:
        raise ConfigError(f'no table {name!r}; there are: {", ".join(TABLES)}')
    tables, request = within(minutes, {name: TABLES[name]}, request, commands)
    return _make(name, tables[name], request, commands)


def make_all(
    request: Request,
    commands: Commands | None = None,
    minutes: float | None = None,
    names: Sequence[str] = ALL,
) -> str:
    """Make tables in order of worth; those that fail are told.

    Args:
        request: One folder for all: tables share their runs.
        commands: What trains and tests.
        minutes: For all of them, kept by making them smaller; None: as long as it takes.
        names: Which, in which order.

    Returns:
        All tables in markdown, with date, machine and commit; ``out/all.md`` holds it.
    """
    began, texts = time.monotonic(), [head()]
    tables, request = within(minutes, {name: TABLES[name] for name in names}, request, commands)
    for number, (name, table) in enumerate(tables.items()):
        request.log(f'{name}: table {number + 1} of {len(tables)}, after {duration(time.monotonic() - began)}')
        try:
            told = to_markdown(_make(name, table, request, commands))
        except ConfigError as error:
            told = f'not made: {error}\n'
        texts.append(f'## {name}\n\n{told}'.rstrip())
        write_text(request.out / 'all.md', '\n\n'.join(texts) + '\n')
    return '\n\n'.join(texts) + '\n'


def within(
    minutes: float | None, tables: Mapping[str, AnyTable], request: Request, commands: Commands | None
) -> tuple[dict[str, AnyTable], Request]:
    """Tables and request, smaller where the time asks for it.

    Raises:
        ConfigError: A table is trained on real data.
    """
    if minutes is None:
        return dict(tables), request
    scale = choose_scale(list(tables.values()), request, minutes, commands)
    return {name: scaled_table(table, scale) for name, table in tables.items()}, scaled_request(request, scale)


def list_tables(request: Request) -> str:
    """A line a table: its name, how many runs it trains, its title."""
    lines = []
    for name, table in TABLES.items():
        made = 'measured' if isinstance(table, MeasuredTable) else f'{len(plan(table.rows, request))} runs'
        lines.append(f'{name:<26}{made:<10}{table.title}')
    return '\n'.join([*lines, f'{"all":<26}{"":<10}{", ".join(ALL)}'])


def head() -> str:
    """Date, version, commit and machine."""
    facts = machine()
    where = f'{facts["processor"]}, {facts["cores"]} cores, GPU: {facts["gpu"] or "none"}'
    return (
        f'# Tables, {datetime.date.today().isoformat()}\n\nrm3d_plugin {__version__}, commit {commit()}; {where}; '
        f'Python {facts["python"]}, torch {facts["torch"]}, numba {facts["numba"]}.'
    )


def commit() -> str:
    """Of the checkout that this package lies in; '-' where it lies in none."""
    here = Path(__file__).resolve().parent
    try:
        done = subprocess.run(['git', 'rev-parse', '--short', 'HEAD'], cwd=here, capture_output=True, text=True)
    except OSError:
        return '-'
    return done.stdout.strip() or '-'


def _make(name: str, table: AnyTable, request: Request, commands: Commands | None) -> FilledTable:
    if isinstance(table, MeasuredTable):
        filled = table.measure(request)
    else:
        run_rows(table.rows, request, commands)
        filled = fill_table(table, request) if isinstance(table, Table) else fill_paper_table(table, request)
    save(filled, request.out, name)
    return filled
