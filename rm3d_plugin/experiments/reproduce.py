"""Makes a table: trains or measures what it needs, and writes it in every format."""

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.render import FilledTable, save
from rm3d_plugin.experiments.runner import Commands, plan, run_rows
from rm3d_plugin.experiments.scores import fill_table
from rm3d_plugin.experiments.spec import Request, Table
from rm3d_plugin.experiments.tables import TABLES


def make_table(name: str, request: Request, commands: Commands | None = None) -> FilledTable:
    """Make a table; ``out/NAME.md``, ``.csv``, ``.json``, ``.tex`` and ``.png`` hold it.

    Args:
        name: Key of :data:`rm3d_plugin.experiments.tables.TABLES`.
        request: Where, with which seeds, options and scenes.
        commands: What trains and tests.

    Raises:
        ConfigError: There is no such table; a run failed or was made with other options; data are missing.
    """
    if name not in TABLES:
        raise ConfigError(f'no table {name!r}; there are: {", ".join(TABLES)}')
    table = TABLES[name]
    if isinstance(table, Table):
        run_rows(table.rows, request, commands)
        filled = fill_table(table, request)
    else:
        filled = table.measure(request)
    save(filled, request.out, name)
    return filled


def list_tables(request: Request) -> str:
    """A line a table: its name, how many runs it trains, its title."""
    lines = []
    for name, table in TABLES.items():
        made = f'{len(plan(table.rows, request))} runs' if isinstance(table, Table) else 'measured'
        lines.append(f'{name:<22}{made:<10}{table.title}')
    return '\n'.join(lines)
