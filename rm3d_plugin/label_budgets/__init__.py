"""Which labels training may see: drawn once, stored with a hash, and audited."""

from rm3d_plugin.label_budgets.audit import hide, scramble_hidden
from rm3d_plugin.label_budgets.box_files import load_box_budget, save_box_budget
from rm3d_plugin.label_budgets.boxes import (
    BOX_BUDGETS,
    BoxAmount,
    BoxBudget,
    BudgetError,
    count_points,
    draw_box_budget,
)

__all__ = [
    'BOX_BUDGETS',
    'BoxAmount',
    'BoxBudget',
    'BudgetError',
    'count_points',
    'draw_box_budget',
    'hide',
    'load_box_budget',
    'save_box_budget',
    'scramble_hidden',
]
