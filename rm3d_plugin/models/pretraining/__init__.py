"""Learning from scans without labels: a network whose losses read features and views alone."""

from rm3d_plugin.models.pretraining.matches import Matches, match_views
from rm3d_plugin.models.pretraining.pretraining import Encoded, Pretraining

__all__ = ['Encoded', 'Matches', 'Pretraining', 'match_views']
