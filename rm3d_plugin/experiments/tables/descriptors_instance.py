"""Table 2 of the paper: instances by descriptor and label budget, as scanned and turned."""

from collections.abc import Sequence
from typing import Any

from rm3d_plugin.experiments.compared_descriptors import compared_descriptors
from rm3d_plugin.experiments.spec import Row, Table
from rm3d_plugin.inference.oversegment import presets_of
from rm3d_plugin.registry import DESCRIPTORS

BUDGETS = ('0p2pct', '0p4pct', '0p6pct', '0p8pct', '1pct')
CONFIG = 'rm3d_ins_scannet_0p2pct'


def instance_table(budgets: Sequence[str], names: Sequence[str] | None = None) -> Table:
    """AP50 of instances on synthetic rooms; for each budget every descriptor, as scanned and turned.

    Labels are made by merging alone (``strategy='paper'``), since a random walk hardly asks the descriptor. Turned: the
    descriptor sees each scene after a random turn; all else is as scanned.

    Args:
        budgets: Label budgets, as configs name them.
        names: Descriptors; None: all that are compared.
    """
    names = compared_descriptors() if names is None else names
    rows = [row for budget in budgets for name in names for row in _rows(name, budget)]
    return Table(
        title='AP50 of instances on synthetic rooms by descriptor, in percent; labels by merging alone',
        rows=tuple(rows),
        scores={'AP50': 'AP50', 'mIoU': 'mIoU'},
        labels=True,
    )


def _rows(name: str, budget: str) -> list[Row]:
    percent = budget.removesuffix('pct').replace('p', '.')
    kind = {'type': name, **presets_of(DESCRIPTORS.module_dict[name]).get('indoor', {})}
    turned = {'type': 'TurnedScene', 'base': kind}
    options: dict[str, Any] = {'budget': budget, 'strategy': 'paper'}
    return [
        Row(f'{name} ({percent} %{shown})', CONFIG, options | {'descriptor': {'_delete_': True, **part}})
        for shown, part in (('', kind), (', turned', turned))
    ]


TABLE_2 = instance_table(BUDGETS)
