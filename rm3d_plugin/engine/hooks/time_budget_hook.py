"""Training that ends in time."""

import time

from mmengine.dist import is_main_process
from mmengine.hooks import Hook
from mmengine.runner import Runner
from tqdm import tqdm

from rm3d_plugin.registry import HOOKS


@HOOKS.register_module()
class TimeBudgetHook(Hook):
    """Show how much of the training is left, and end it after the epoch in which its time is over.

    For one process. How many epochs fit is for the config to say; this is for computers that become slower.

    Args:
        seconds: From the making of this hook on, labels and validation included. Larger: training may take longer.
    """

    priority = 'VERY_LOW'

    def __init__(self, seconds: float) -> None:
        if not seconds > 0:
            raise ValueError(f'TimeBudgetHook.seconds: expected a number > 0, got {seconds}')
        self._until = time.monotonic() + seconds
        self._bar: tqdm | None = None

    def before_train(self, runner: Runner) -> None:
        """Begin to count epochs."""
        hidden = None if is_main_process() else True
        self._bar = tqdm(total=runner.max_epochs, desc='training', unit='epoch', disable=hidden)

    def after_train_epoch(self, runner: Runner) -> None:
        """Count, and stop where the time is over."""
        if self._bar is not None:
            self._bar.update()
        if time.monotonic() > self._until:
            runner.train_loop.stop_training = True

    def after_train(self, runner: Runner) -> None:
        """End the bar."""
        if self._bar is not None:
            self._bar.close()
