"""Detectors."""

from rm3d_plugin.models.detectors.rm3d_votenet import RM3DVoteNet, detection_losses

__all__ = ['RM3DVoteNet', 'detection_losses']
