"""Regions that merge: similarities, conditions, schedule, and the ledger that says why."""

from rm3d_plugin.regions.ledger import MergeLedger, Reason
from rm3d_plugin.regions.merge import MergeResult, RegionEvidence, merge
from rm3d_plugin.regions.rules import MergeRules, TermWeights

__all__ = ['MergeLedger', 'MergeResult', 'MergeRules', 'RegionEvidence', 'Reason', 'TermWeights', 'merge']
