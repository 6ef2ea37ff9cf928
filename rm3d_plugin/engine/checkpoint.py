"""Checkpoints, as the engine reads them: ``storage.checkpoint``, which descriptors below the engine read, too."""

from rm3d_plugin.storage.checkpoint import check_whole as check_whole
from rm3d_plugin.storage.checkpoint import load_weights as load_weights
from rm3d_plugin.storage.checkpoint import read_checkpoint as read_checkpoint
