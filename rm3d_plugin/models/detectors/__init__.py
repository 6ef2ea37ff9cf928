"""Detectors."""

from rm3d_plugin.models.detectors.rm3d_votenet import NetworkOutput, RM3DVoteNet

__all__ = ['NetworkOutput', 'RM3DVoteNet']
