"""One hook a file; each decides when, and calls one thing."""

from rm3d_plugin.engine.hooks.descriptor_weights_hook import DescriptorWeightsHook
from rm3d_plugin.engine.hooks.ema_teacher_hook import EMATeacherHook
from rm3d_plugin.engine.hooks.prediction_quality_hook import PredictionQualityHook
from rm3d_plugin.engine.hooks.pretraining_hook import PretrainingHook
from rm3d_plugin.engine.hooks.region_merge_hook import RegionMergeHook
from rm3d_plugin.engine.hooks.run_record_hook import RunRecordHook
from rm3d_plugin.engine.hooks.safe_checkpoint_hook import SafeCheckpointHook
from rm3d_plugin.engine.hooks.seed_hook import EpochSeedHook
from rm3d_plugin.engine.hooks.time_budget_hook import TimeBudgetHook

__all__ = [
    'DescriptorWeightsHook',
    'EMATeacherHook',
    'EpochSeedHook',
    'PredictionQualityHook',
    'PretrainingHook',
    'RegionMergeHook',
    'RunRecordHook',
    'SafeCheckpointHook',
    'TimeBudgetHook',
]
