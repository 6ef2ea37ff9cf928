"""Spreading few labels over a scan: a random walker with features as its prior, checked by labels that are left out."""

from rm3d_plugin.pseudo_labels.propagation.beside import Beside, examples_of
from rm3d_plugin.pseudo_labels.propagation.estimate import Estimate
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud, prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.propagate import Propagation, propagate, propagate_prepared
from rm3d_plugin.pseudo_labels.propagation.rules import WalkerRules

__all__ = [
    'Beside',
    'Estimate',
    'PreparedCloud',
    'Propagation',
    'WalkerRules',
    'examples_of',
    'prepare_cloud',
    'propagate',
    'propagate_prepared',
]
