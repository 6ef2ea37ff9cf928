"""Further views of a batch, a teacher, and features kept from earlier batches."""

from rm3d_plugin.models.consistency.common_points import common_rows
from rm3d_plugin.models.consistency.memory_bank import BankRows, MemoryBank
from rm3d_plugin.models.consistency.progress import training_progress
from rm3d_plugin.models.consistency.prototype_bank import GroupMeans, PrototypeBank, group_means
from rm3d_plugin.models.consistency.running_statistics import kept_statistics
from rm3d_plugin.models.consistency.teacher import Teacher
from rm3d_plugin.models.consistency.view import View

__all__ = [
    'BankRows',
    'GroupMeans',
    'MemoryBank',
    'PrototypeBank',
    'Teacher',
    'View',
    'common_rows',
    'group_means',
    'kept_statistics',
    'training_progress',
]
