"""Leaves what a learned descriptor needs of a training: ``descriptor.npz``."""

from pathlib import Path

from mmengine.dist import is_main_process
from mmengine.hooks import Hook
from mmengine.model import is_model_wrapper
from mmengine.runner import Runner

from rm3d_plugin.descriptors.learned.weights_file import write_weights
from rm3d_plugin.registry import HOOKS


@HOOKS.register_module()
class DescriptorWeightsHook(Hook):
    """Write ``WORK_DIR/descriptor.npz`` when training ends: ``descriptor.checkpoint=WORK_DIR/descriptor.npz`` uses it.

    It holds the network alone, in half precision: a tenth of a checkpoint, and nothing that training alone needs.
    """

    priority = 'VERY_LOW'

    def after_train(self, runner: Runner) -> None:
        """Write the last weights."""
        if is_main_process():
            model = runner.model.module if is_model_wrapper(runner.model) else runner.model
            config = runner.cfg.model.to_dict()
            write_weights(Path(runner.work_dir) / 'descriptor.npz', config, model.state_dict())
