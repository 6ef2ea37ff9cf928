"""Descriptors learnt from scans: a provider each, which reads a checkpoint; their networks are in ``models``."""

from rm3d_plugin.descriptors.learned.base import LearnedDescriptor
from rm3d_plugin.descriptors.learned.contrastive import Contrastive
from rm3d_plugin.descriptors.learned.predator import Predator

__all__ = ['Contrastive', 'LearnedDescriptor', 'Predator']
