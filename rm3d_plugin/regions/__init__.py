"""Regions that merge: similarities, conditions, schedule, and the ledger that says why."""

from rm3d_plugin.regions.ledger import MergeLedger, Reason
from rm3d_plugin.regions.merge import MergeResult, merge
from rm3d_plugin.regions.rules import MergeRules, TermWeights
from rm3d_plugin.regions.strategy import MergeStrategy

__all__ = ['MergeLedger', 'MergeResult', 'MergeRules', 'MergeStrategy', 'Reason', 'TermWeights', 'merge']
