"""Rows that the paper's tables share: what is trivial, both strategies, every compared method, every descriptor."""

from collections.abc import Iterable, Mapping
from typing import Any

from rm3d_plugin.baselines import BASELINES, FULL_SUPERVISION, LABELLED_ONLY, Task
from rm3d_plugin.baselines.base import Baseline
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.compared_descriptors import compared_descriptors
from rm3d_plugin.experiments.paper import paper_table
from rm3d_plugin.experiments.run_commands import config_path
from rm3d_plugin.experiments.spec import DEMO, Row

PAPER, DEFAULT = 'RM3D as in the paper', 'RM3D'
AS_PAPER = {'strategy': 'paper'}
RADIUS = ('FPFH', 'SHOT')  # descriptors that take AdaptedPFH's radius as it stands in a config
LEAF_BUDGETS: dict[Task, str] = {'sem': '0p2pct', 'ins': '0p2pct', 'votenet': '1pct'}  # every method has these leaves


def leaf_row(
    name: str, config: str, options: Mapping[str, Any] | None = None, paper: str = '', test: Any = None
) -> Row:
    """A row that is trained on the demo.

    Args:
        name: As the table prints it.
        config: Name of a leaf.
        options: Config keys that differ from it.
        paper: Row of the paper's table.
        test: Config keys of the test; None: the last validation counts.
    """
    return Row(name, config, options or {}, DEMO, test, paper=paper)


def trivial_rows(task: Task, data: str, budget: str) -> tuple[Row, Row]:
    """The network on the labels alone, and RM3D as it is by default: what stands beside the paper's method."""
    return (
        leaf_row(LABELLED_ONLY.row(task), LABELLED_ONLY.config(task, data, budget)),
        leaf_row(DEFAULT, f'rm3d_{task}_{data}_{budget}'),
    )


def method_rows_of(task: Task, data: str, budget: str) -> tuple[Row, ...]:
    """Every method that has a config for a task and data set, RM3D with both strategies first; full supervision last.

    Args:
        task: sem, ins or votenet.
        data: Data set, as configs name it.
        budget: Label budget, as configs name it.
    """
    leaf = rm3d_leaf(task, data, budget)
    ours = (
        leaf_row(PAPER, leaf[0], {**leaf[1], **AS_PAPER}, f'rm3d {budget}'),
        leaf_row(DEFAULT, leaf[0], leaf[1], f'rm3d {budget}'),
    )
    compared = [baseline for baseline in BASELINES.values() if baseline is not FULL_SUPERVISION]
    others = [row for baseline in compared if (row := _compared(baseline, task, data, budget)) is not None]
    full = leaf_row(
        FULL_SUPERVISION.row(task), FULL_SUPERVISION.config(task, data, ''), paper=f'{FULL_SUPERVISION.name} full'
    )
    return (*ours, *others, full)


def rm3d_leaf(task: Task, data: str, budget: str) -> tuple[str, dict[str, Any]]:
    """Leaf of RM3D for a budget, and the options where no leaf has that budget."""
    return with_budget(f'rm3d_{task}_{data}_{{budget}}', task, budget)


def descriptor_rows(config: str, options: Mapping[str, Any], test: Any = None) -> tuple[Row, ...]:
    """A row for each registered descriptor, those of the paper in its order, further ones behind them.

    Args:
        config: Name of a leaf.
        options: Of every row.
        test: Config keys of the test.
    """
    return tuple(leaf_row(name, config, {**options, **descriptor(name)}, name, test) for name in descriptor_names())


def descriptor_names() -> list[str]:
    """Descriptors that work at once, those of the paper in its order; what joins the registry joins here."""
    known = compared_descriptors()
    first = [name for name in paper_table('table_inseg') if name in known]
    return [*first, *(name for name in known if name not in first)]


def descriptor(name: str) -> dict[str, Any]:
    """Options that put a descriptor in the place of AdaptedPFH; {} for itself."""
    if name == 'AdaptedPFH':
        return {}
    return {'descriptor.type': name} if name in RADIUS else {'descriptor._delete_': True, 'descriptor.type': name}


def has_config(name: str) -> bool:
    """Whether a config of that name comes with RM3D."""
    try:
        return config_path(name).is_file()
    except ConfigError:
        return False


def once(rows: Iterable[Row]) -> tuple[Row, ...]:
    """The rows, each name once, the first of them."""
    found: dict[str, Row] = {}
    for row in rows:
        found.setdefault(row.name, row)
    return tuple(found.values())


def _compared(baseline: Baseline, task: Task, data: str, budget: str) -> Row | None:
    config, options = with_budget(baseline.config(task, data, '{budget}'), task, budget)
    if not has_config(config):
        return None
    return leaf_row(baseline.row(task), config, options, f'{baseline.name} {budget}')


def with_budget(leaf: str, task: Task, budget: str) -> tuple[str, dict[str, Any]]:
    """The leaf that has a budget, or the usual one and the option that changes it; so tables share runs.

    Args:
        leaf: Name of a config, ``{budget}`` in the place of the budget.
        task: sem, ins or votenet.
        budget: Label budget, as configs name it.
    """
    own = leaf.format(budget=budget)
    if has_config(own):
        return own, {}
    return leaf.format(budget=LEAF_BUDGETS[task]), {'budget': budget}
