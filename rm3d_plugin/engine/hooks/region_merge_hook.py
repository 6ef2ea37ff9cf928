"""Regenerates the pseudo labels every sigma epochs."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

import torch
from mmengine.dist import barrier, is_main_process
from mmengine.hooks import Hook
from mmengine.runner import IterBasedTrainLoop, Runner
from tqdm import tqdm

from rm3d_plugin.engine.config_files import ConfigError
from rm3d_plugin.engine.hooks.ema_teacher_hook import EMATeacherHook
from rm3d_plugin.engine.hooks.safe_checkpoint_hook import forget_checkpoints
from rm3d_plugin.engine.round_times import RoundTimes, Seconds, Stopwatch
from rm3d_plugin.engine.scene_prediction import scene_prediction
from rm3d_plugin.labeling.label_maker import LabelMaker
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.registry import HOOKS, TASK_UTILS


@HOOKS.register_module()
class RegionMergeHook(Hook):
    """Decides when: before training the first labels are made, then every ``interval`` epochs new ones (METHOD 1).

    How they are made is the label maker's business. The hook works in any mmengine project whose model has
    ``set_label_statistics(statistics)`` (:class:`~rm3d_plugin.structures.LabelStatistics`; it may do nothing) and, in
    mode ``predict``, returns data samples with ``pred_point_probs`` (n, classes) and optionally ``pred_point_centers``
    (n, 3) and ``point_index`` (n,). Training runs by epochs.

    Args:
        interval: sigma, epochs between two refreshes.
        rounds: Sets of labels in the whole run; the first is made without a network.
        label_maker: A label maker (:class:`~rm3d_plugin.labeling.label_maker.LabelMaker`) or its config.
        warm_up_rounds: How many intervals the first labels last. Larger: the first predictions come from a network that
            has seen more, which counts where few labels are annotated or epochs are short.
        dataloader: Config of a dataloader over the training scenes, without labels and augmentation, in order.
        labels_from: Whose predictions make labels: the 'network', or its 'teacher', which
            :class:`~rm3d_plugin.engine.hooks.EMATeacherHook` gives it.

    Attributes:
        seconds: Wall clock, spent on labels by this process.
        times: What each round took, kept in ``timing.json``.
    """

    priority = 'HIGH'

    def __init__(
        self,
        interval: int,
        label_maker: dict[str, Any] | LabelMaker,
        dataloader: Any,
        rounds: int = 8,
        warm_up_rounds: int = 1,
        labels_from: Literal['network', 'teacher'] = 'network',
    ) -> None:
        if labels_from not in ('network', 'teacher'):
            raise ValueError(f"RegionMergeHook.labels_from: expected 'network' or 'teacher', got {labels_from!r}")
        for name, value in (('interval', interval), ('rounds', rounds), ('warm_up_rounds', warm_up_rounds)):
            if int(value) < 1:
                raise ValueError(f'RegionMergeHook.{name}: expected at least 1, got {value}')
        self.interval = interval
        self.rounds = rounds
        self.warm_up_rounds = warm_up_rounds
        self.dataloader = dataloader
        self.labels_from = labels_from
        self.seconds = 0.0
        self.times: RoundTimes
        self._predicting = Seconds()
        self._told: int | None = None  # the round whose statistics the model has
        self._epoch = Stopwatch()
        self.label_maker: LabelMaker = TASK_UTILS.build(label_maker) if isinstance(label_maker, dict) else label_maker

    def before_train(self, runner: Runner) -> None:
        """Prepare the geometry, make the first labels, and tell the model what the annotated labels say as a whole.

        Raises:
            ConfigError: Training does not run by epochs, or the model cannot be told.
        """
        _check_project(runner)
        if self.labels_from == 'teacher' and not any(isinstance(hook, EMATeacherHook) for hook in runner.hooks):
            raise ConfigError(
                "labels_from: 'teacher', but the network has none; add method_hook=${mean_teacher} (EMATeacherHook)"
            )
        watch = Stopwatch()
        self.times = RoundTimes(runner.work_dir, runner.epoch)
        if isinstance(self.dataloader, Mapping) and self.dataloader['sampler']['type'] == 'DefaultSampler':
            self.dataloader['sampler'].setdefault('round_up', False)  # each scene goes to one process
        self.dataloader = runner.build_dataloader(self.dataloader, seed=runner.seed)
        keep, evaluating = runner.epoch > 0, Seconds()
        if is_main_process():
            self.label_maker.open(keep, runner.logger.info)
            if self.label_maker.source.grown:
                forget_checkpoints(runner.work_dir, runner.epoch)
                self.label_maker.store.forget_rounds(self._next_round(runner.epoch))
            if not (keep and self.label_maker.is_finished(0)):
                self.label_maker.make_first_labels()
                evaluating = self._close(0, runner)
        barrier()
        if not is_main_process():
            self.label_maker.follow()
        self._tell_model(runner.model)
        self._labels_took(0, watch.read(), evaluating, new=not keep)

    def before_train_epoch(self, runner: Runner) -> None:
        """Refresh the labels when a round begins; point the store at the round of this epoch."""
        number = self._round_of(runner.epoch)
        starts = runner.epoch % self.interval == 0
        if number and starts and not self.label_maker.is_finished(number):
            watch, self._predicting = Stopwatch(), Seconds()
            evaluating = self._refresh(runner, number)
            self._labels_took(number, watch.read(), evaluating, new=True)
            self._tell(number, runner)
        barrier()
        self.label_maker.use(number)
        barrier()  # nobody reads labels before the main process has said which
        if number != self._told:
            self._tell_model(runner.model)
            self._told = number
        self._epoch = Stopwatch()

    def after_train_epoch(self, runner: Runner) -> None:
        """Note what the epoch took."""
        if is_main_process():
            self.times.epoch(runner.epoch + 1, self._round_of(runner.epoch), self._epoch.read())

    def _round_of(self, epoch: int) -> int:
        """Whose labels an epoch (from 0) is trained on."""
        return min(max(epoch // self.interval - self.warm_up_rounds + 1, 0), self.rounds - 1)

    def _next_round(self, epoch: int) -> int:
        """Which round begins first from an epoch on; round 0 has begun."""
        return max(self._round_of(-(-epoch // self.interval) * self.interval), 1)

    def _tell_model(self, model: Any) -> None:
        _unwrapped(model).set_label_statistics(self.label_maker.statistics())

    def _labels_took(self, number: int, seconds: Seconds, evaluating: Seconds, new: bool) -> None:
        self.seconds += seconds.wall
        if new and is_main_process():
            self.times.labels(number, seconds.minus(evaluating), self._predicting, evaluating)

    def _tell(self, number: int, runner: Runner) -> None:
        if not is_main_process():
            return
        taken, before = self.times.rounds()[-1], self.times.training(number - 1)
        share = f', {100 * taken.labels / before.wall:.0f} % of the training before' if before.wall else ''
        runner.logger.info(f'labels of round {number} took {taken.labels:.1f} s{share}')

    def _refresh(self, runner: Runner, number: int) -> Seconds:
        """Make the labels of a round; what evaluating them took."""
        if is_main_process():
            self.label_maker.begin(number)
        barrier()
        said = f'labels, round {number}'
        if self.label_maker.source.extends(number):
            self.label_maker.extend_budget(number, self.predictions(self._asked(runner.model), said))
            self._tell_model(runner.model)
            if self.labels_from == 'teacher':
                self._tell_model(self._asked(runner.model))
        self.label_maker.refresh_all(number, self.predictions(self._asked(runner.model), said))
        barrier()
        return self._close(number, runner) if is_main_process() else Seconds()

    def _asked(self, model: Any) -> Any:
        """Whose predictions make the labels.

        Raises:
            ConfigError: The teacher begins later.
        """
        if self.labels_from == 'network':
            return model
        teacher = _unwrapped(model).teacher
        if teacher is None:
            raise ConfigError('labels_from: the teacher begins after these labels; lower mean_teacher.start')
        return teacher

    def _close(self, number: int, runner: Runner) -> Seconds:
        """Check, evaluate and close a round; what evaluating took, which is no part of the method."""
        self.label_maker.check(number, runner.logger.info)
        watch = Stopwatch()
        summary = self.label_maker.evaluate(number)
        taken = watch.read()
        self.label_maker.finish(number, summary, runner.logger.info)
        return taken

    def predictions(self, model: Any, why: str) -> Iterator[tuple[str, PointPrediction]]:
        """What the network says of the training scenes of this process, one by one; it is left in evaluation.

        Args:
            model: The network.
            why: Stands before the progress bar.
        """
        model.eval()
        _unwrapped(model).predict_points = True
        _unwrapped(model).predict_features = self.label_maker.reads_features
        batches = tqdm(self.dataloader, desc=why, disable=not is_main_process())
        for batch in batches:  # the sampler gives each process its share
            watch = Stopwatch()
            with torch.no_grad():
                found = [scene_prediction(sample) for sample in model.test_step(batch)]
            self._predicting = self._predicting.plus(watch.read())
            yield from found
        _unwrapped(model).predict_points = False


def _check_project(runner: Runner) -> None:
    """Whether the hook can work in this run."""
    if isinstance(runner.train_loop, IterBasedTrainLoop):
        raise ConfigError(
            'RegionMergeHook: labels are made anew every so many epochs, but training runs by iterations; set '
            'train_cfg=dict(by_epoch=True, max_epochs=...)'
        )
    model = _unwrapped(runner.model)
    if not hasattr(model, 'set_label_statistics'):
        raise ConfigError(
            f'RegionMergeHook: {type(model).__name__} has no set_label_statistics(statistics), which is told what the '
            'annotated labels say as a whole; add it to the model (it may do nothing)'
        )


def _unwrapped(model: Any) -> Any:
    return getattr(model, 'module', model)
