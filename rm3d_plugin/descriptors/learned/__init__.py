"""Descriptors that were learnt from scans: a provider each, which reads a checkpoint; the networks are in ``models``."""

from rm3d_plugin.descriptors.learned.base import LearnedDescriptor
from rm3d_plugin.descriptors.learned.contrastive import Contrastive

__all__ = ['Contrastive', 'LearnedDescriptor']
