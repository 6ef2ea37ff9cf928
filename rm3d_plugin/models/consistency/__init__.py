"""Further views of a batch, and what is compared between them."""

from rm3d_plugin.models.consistency.common_points import common_rows
from rm3d_plugin.models.consistency.progress import training_progress
from rm3d_plugin.models.consistency.running_statistics import kept_statistics
from rm3d_plugin.models.consistency.view import View

__all__ = ['View', 'common_rows', 'kept_statistics', 'training_progress']
