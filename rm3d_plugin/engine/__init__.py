"""When things happen: hooks, loops, runs, reports. No maths."""

from rm3d_plugin.engine import hooks as hooks
from rm3d_plugin.engine.autocast import CPUAutocastOptimWrapper
from rm3d_plugin.engine.base_labeler import BaseLabeler, PointPrediction
from rm3d_plugin.engine.labeler import SceneLabeler
from rm3d_plugin.engine.loops import RoundTrainLoop
from rm3d_plugin.engine.point_labeler import PointLabeler
from rm3d_plugin.engine.point_source import PointBudgetSource
from rm3d_plugin.engine.region_numbers import RegionNumbers
from rm3d_plugin.engine.sources import BoxBudgetSource, DatasetSource, LabelSource

__all__ = [
    'BaseLabeler',
    'BoxBudgetSource',
    'CPUAutocastOptimWrapper',
    'DatasetSource',
    'LabelSource',
    'PointBudgetSource',
    'PointLabeler',
    'PointPrediction',
    'RegionNumbers',
    'RoundTrainLoop',
    'SceneLabeler',
    'hooks',
]
