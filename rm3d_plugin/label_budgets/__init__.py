"""Which labels training may see: drawn once, stored with a hash, and audited."""

from rm3d_plugin.label_budgets.audit import (
    AnnotatedPoints,
    check_objects,
    hide,
    hide_points,
    scramble_hidden,
    scramble_hidden_points,
)
from rm3d_plugin.label_budgets.base import BudgetError
from rm3d_plugin.label_budgets.box_amount import BOX_BUDGETS, BoxAmount, box_amount
from rm3d_plugin.label_budgets.box_files import load_box_budget, save_box_budget
from rm3d_plugin.label_budgets.boxes import BoxBudget, count_points, draw_box_budget
from rm3d_plugin.label_budgets.clicks import budget_from_clicks, clicks_of
from rm3d_plugin.label_budgets.growth import grown, part_of
from rm3d_plugin.label_budgets.point_amount import PointAmount, point_amount
from rm3d_plugin.label_budgets.point_files import load_point_budget, save_point_budget
from rm3d_plugin.label_budgets.point_lists import import_point_list, read_point_list, read_scene_list
from rm3d_plugin.label_budgets.points import PointBudget, SceneSize, draw_point_budget, draw_points

__all__ = [
    'check_objects',
    'BOX_BUDGETS',
    'BoxAmount',
    'BoxBudget',
    'BudgetError',
    'PointAmount',
    'PointBudget',
    'AnnotatedPoints',
    'SceneSize',
    'box_amount',
    'budget_from_clicks',
    'clicks_of',
    'count_points',
    'draw_box_budget',
    'draw_point_budget',
    'draw_points',
    'grown',
    'hide',
    'hide_points',
    'import_point_list',
    'load_box_budget',
    'load_point_budget',
    'part_of',
    'point_amount',
    'read_point_list',
    'read_scene_list',
    'save_box_budget',
    'save_point_budget',
    'scramble_hidden',
    'scramble_hidden_points',
]
