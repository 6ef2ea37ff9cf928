"""When things happen: hooks, loops, runs. No maths."""

from rm3d_plugin.engine import hooks as hooks
from rm3d_plugin.engine.autocast import CPUAutocastOptimWrapper
from rm3d_plugin.engine.loops import RoundTrainLoop

__all__ = ['CPUAutocastOptimWrapper', 'RoundTrainLoop', 'hooks']
