"""Figures and the HTML report, from structures and plain values."""

from rm3d_plugin.visualization.bev import BevPanel, BoxLayer, draw_bev, scene_panels
from rm3d_plugin.visualization.curves import Chart, Series, draw_chart
from rm3d_plugin.visualization.report import (
    BudgetSummary,
    Picture,
    ResultRow,
    RunReport,
    ScoreTable,
    render_report,
    write_report,
)
from rm3d_plugin.visualization.report_merges import MergeReport, MergeRow
from rm3d_plugin.visualization.report_times import RoundTime
from rm3d_plugin.visualization.scene_view import Layer, SceneView, pack_views

__all__ = [
    'BevPanel',
    'BoxLayer',
    'BudgetSummary',
    'Chart',
    'Layer',
    'MergeReport',
    'MergeRow',
    'Picture',
    'ResultRow',
    'RoundTime',
    'RunReport',
    'ScoreTable',
    'Series',
    'SceneView',
    'draw_bev',
    'draw_chart',
    'pack_views',
    'render_report',
    'scene_panels',
    'write_report',
]
