"""A teacher that follows the network slowly."""

from typing import Any

from mmengine.hooks import Hook
from mmengine.model import ExponentialMovingAverage
from mmengine.runner import Runner

from rm3d_plugin.registry import HOOKS

KEY = 'teacher'  # of a checkpoint


@HOOKS.register_module()
class EMATeacherHook(Hook):
    """Gives the model a teacher: a copy whose weights are the running mean of its own (mean teacher).

    Losses find its answers in ``batch.teacher``. Weights are averaged; buffers, such as the statistics of batch
    normalisation, are copied. The teacher lies in the checkpoint beside the network, which is tested without it.

    Args:
        momentum: Share of the old weights that stays at a step; larger: slower.
        start: Steps before the teacher begins as a copy of the network; until then there is none.
    """

    def __init__(self, momentum: float = 0.999, start: int = 1) -> None:
        if not 0 < momentum < 1 or start < 1:
            raise ValueError(f'EMATeacherHook: expected momentum in (0, 1) and start >= 1, got {momentum} and {start}')
        self.momentum, self.start = momentum, start
        self._kept: dict[str, Any] | None = None

    def before_train(self, runner: Runner) -> None:
        """Copy the network, or take up the teacher of a resumed run."""
        self._student = getattr(runner.model, 'module', runner.model)
        self._average = ExponentialMovingAverage(self._student, momentum=1 - self.momentum).eval()
        if self._kept is not None:
            self._average.load_state_dict(self._kept)
        self._teach()

    def after_train_iter(self, runner: Runner, batch_idx: int, data_batch: Any = None, outputs: Any = None) -> None:
        """Follow the network."""
        if runner.iter + 1 >= self.start:
            self._average.update_parameters(self._student)
            self._teach()

    def after_train(self, runner: Runner) -> None:
        """Leave the network alone."""
        self._student.set_teacher(None)

    def before_save_checkpoint(self, runner: Runner, checkpoint: dict[str, Any]) -> None:
        """Keep the teacher."""
        checkpoint[KEY] = self._average.state_dict()

    def after_load_checkpoint(self, runner: Runner, checkpoint: dict[str, Any]) -> None:
        """Remember the teacher that a run left."""
        self._kept = checkpoint.get(KEY)

    def _teach(self) -> None:
        if int(self._average.steps):
            self._student.set_teacher(self._average.module)
