"""Keeps ``metrics.json`` of the work directory: losses, scores of each validation, estimates of the labels."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from mmengine.dist import is_main_process
from mmengine.hooks import Hook
from mmengine.runner import Runner

from rm3d_plugin.engine.hooks.region_merge_hook import RegionMergeHook
from rm3d_plugin.evaluation.records import ScoreRecord, records_from, records_of, rows_of
from rm3d_plugin.registry import HOOKS
from rm3d_plugin.storage import content_of, read_sealed, write_sealed
from rm3d_plugin.structures.label_estimate import ESTIMATE, estimate_text, has_estimate


def read_record(work_dir: str | Path) -> dict[str, Any]:
    """The run's ``metrics.json``, or an empty record; a damaged one gives way to that before it, with a warning.

    Raises:
        DamagedFileError: It is no such record.
    """
    path = Path(work_dir) / 'metrics.json'
    if not path.is_file():
        return _empty()
    with content_of(path, 'the record of a run'):
        record = {**_empty(), **read_sealed(path)}
        _check(record)
        return record


def _check(record: Mapping[str, Any]) -> None:
    """Take a record apart as its readers do; raises where one of them would."""
    for part in ('losses', 'validation'):
        for epoch, values in record[part].items():
            _numbers([int(epoch), *values.values()])
    _numbers(record['final'].values())
    for records in score_records(record).values():
        _numbers([row.value for row in records])
    for number, fields in record['estimates'].items():
        int(number), estimate_text({ESTIMATE: fields})


def _numbers(values: Iterable[Any]) -> None:
    if wrong := [value for value in values if not isinstance(value, int | float | None)]:
        raise TypeError(f'expected numbers, got {wrong[0]!r}')


def _empty() -> dict[str, Any]:
    return {'losses': {}, 'validation': {}, 'final': {}, 'records': {}, 'estimates': {}}


def score_records(record: Mapping[str, Any]) -> dict[int, tuple[ScoreRecord, ...]]:
    """Of each validated epoch, in their order, what the metrics handed on; a run of an older version has none."""
    return {int(epoch): records_from(record['records'][epoch]) for epoch in sorted(record['records'], key=int)}


def final_records(record: Mapping[str, Any]) -> tuple[ScoreRecord, ...]:
    """What the metrics handed on after the last validation."""
    by_epoch = score_records(record)
    return by_epoch[max(by_epoch)] if by_epoch else ()


def last_summary(record: Mapping[str, Any]) -> dict[str, Any]:
    """What the record says of the labels of the last round: ``estimate``, where they were checked."""
    estimates = record['estimates']
    return {ESTIMATE: estimates[max(estimates, key=int)]} if estimates else {}


@HOOKS.register_module()
class RunRecordHook(Hook):
    """Write losses and scores as they come; nothing that depends on the clock, so equal runs leave equal files.

    A resumed run forgets what the record says of epochs it will train again, and makes up for a validation that the
    interrupted run did not reach.
    """

    priority = 'LOW'

    def __init__(self) -> None:
        self.record: dict[str, Any] = {}
        self._sums: dict[str, float] = {}
        self._steps = 0

    def before_train(self, runner: Runner) -> None:
        """Take up the record of an interrupted run, or begin a new one."""
        self.record = read_record(runner.work_dir) if runner.epoch else _empty()
        for part in ('losses', 'validation', 'records'):
            self.record[part] = {k: v for k, v in self.record[part].items() if int(k) <= runner.epoch}
        self.record.update(
            config=runner.cfg.get('config_name'), seed=runner.seed, synthetic=bool(runner.cfg.get('is_demo', False))
        )
        loop = runner.train_loop
        due = runner.epoch and (runner.epoch % loop.val_interval == 0 or runner.epoch == loop.max_epochs)
        if runner.val_loop is not None and due and str(runner.epoch) not in self.record['validation']:
            runner.val_loop.run()

    def after_train_iter(
        self, runner: Runner, batch_idx: int, data_batch: Any = None, outputs: dict[str, Any] | None = None
    ) -> None:
        """Add up the losses."""
        for name, value in (outputs or {}).items():
            self._sums[name] = self._sums.get(name, 0.0) + float(torch.as_tensor(value).detach())
        self._steps += 1

    def after_train_epoch(self, runner: Runner) -> None:
        """Write the mean losses of the epoch."""
        means = {name: value / max(self._steps, 1) for name, value in self._sums.items()}
        self.record['losses'][str(runner.epoch + 1)] = means
        self._sums, self._steps = {}, 0
        self._write(runner)

    def after_val_epoch(self, runner: Runner, metrics: dict[str, Any] | None = None) -> None:
        """Write the scores."""
        self.record['validation'][str(runner.epoch)] = dict(metrics or {})
        self.record['records'][str(runner.epoch)] = rows_of(records_of(runner.val_evaluator))
        self._write(runner)

    def after_train(self, runner: Runner) -> None:
        """Write the scores of the last validation as the final ones."""
        scores = self.record['validation']
        if scores:
            self.record['final'] = scores[max(scores, key=int)]
        self._write(runner)

    def _write(self, runner: Runner) -> None:
        if is_main_process():
            self.record['estimates'] = _estimates(runner)
            write_sealed(Path(runner.work_dir) / 'metrics.json', self.record, keep_previous=True)


def _estimates(runner: Runner) -> dict[str, Any]:
    """Of each round whose labels were checked by left-out clicks, its estimate; None: too few clicks."""
    stores = [hook.label_maker.store for hook in runner.hooks if isinstance(hook, RegionMergeHook)]
    rounds = {str(number): store.summary(number) for store in stores for number in store.rounds()}
    return {number: summary[ESTIMATE] for number, summary in rounds.items() if has_estimate(summary)}
