"""Metrics: registered shells over the plain functions of ``functional``."""

from rm3d_plugin.evaluation.kitti_metric import KittiMetric
from rm3d_plugin.evaluation.overseg_metric import OversegMetric

__all__ = ['KittiMetric', 'OversegMetric']
