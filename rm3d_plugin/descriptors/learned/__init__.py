"""Descriptors learnt from scans: a provider each, which reads a checkpoint; their networks are in ``models``."""

from rm3d_plugin.descriptors.learned.base import LearnedDescriptor
from rm3d_plugin.descriptors.learned.contrastive import Contrastive
from rm3d_plugin.descriptors.learned.point_sift import PointSIFT
from rm3d_plugin.descriptors.learned.predator import Predator
from rm3d_plugin.descriptors.learned.semantic import Semantic
from rm3d_plugin.descriptors.learned.supervised_superpoint import SupervisedSuperpoint

__all__ = ['Contrastive', 'LearnedDescriptor', 'PointSIFT', 'Predator', 'Semantic', 'SupervisedSuperpoint']
