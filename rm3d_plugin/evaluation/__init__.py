"""Metrics: registered shells over the plain functions of ``functional``."""

from rm3d_plugin.evaluation.kitti_metric import KittiMetric

__all__ = ['KittiMetric']
