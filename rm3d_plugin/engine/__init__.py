"""When things happen: hooks, loops, runs, reports. No maths."""

from rm3d_plugin.engine import hooks as hooks
from rm3d_plugin.engine.labeler import PointPrediction, SceneLabeler
from rm3d_plugin.engine.loops import RoundTrainLoop
from rm3d_plugin.engine.sources import BoxBudgetSource, LabelSource

__all__ = ['BoxBudgetSource', 'LabelSource', 'PointPrediction', 'RoundTrainLoop', 'SceneLabeler', 'hooks']
