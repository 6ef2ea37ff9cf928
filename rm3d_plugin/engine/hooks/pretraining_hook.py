"""Weights of the backbone from the scans alone, learnt once for all budgets."""

import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import torch
from mmengine.dist import barrier, is_main_process
from mmengine.hooks import Hook
from mmengine.optim import build_optim_wrapper
from mmengine.runner import Runner

from rm3d_plugin.engine.config_files import ConfigError
from rm3d_plugin.models.pretraining import Pretraining
from rm3d_plugin.registry import DATASETS, HOOKS, MODELS
from rm3d_plugin.storage import content_key, write_json
from rm3d_plugin.storage.files import atomic_write
from rm3d_plugin.storage.locks import waiting_lock

VERSION = 1  # raise it when the same settings give other weights than before
VIEW = 'AugmentedView'  # the step of a pipeline in whose place two crops are taken
LABELLED = 'LabelledObjectPaste'  # a step that reads labels
RECORD = 'pretraining.json'


class Task(NamedTuple):
    """All that decides what is learnt; the scans of ``dataset`` count by their points."""

    loss: Mapping[str, Any]
    network: Mapping[str, Any]
    optimizer: Mapping[str, Any]
    pipeline: Sequence[Mapping[str, Any]]
    epochs: int
    batch_size: int
    seed: int
    dataset: Mapping[str, Any]


class Schooling(NamedTuple):
    """What is learnt: network and optimizer, its steps, and the batches of an epoch."""

    network: Pretraining
    optimizer: Any
    schedule: torch.optim.lr_scheduler.LRScheduler
    loader: Any


@HOOKS.register_module()
class PretrainingHook(Hook):
    """Before training, the backbone learns by a loss on two overlapping crops of each scan; no label is read.

    Scans, steps of the pipeline, batch size, optimizer and length are those of training. What was learnt lies in a
    cache under a name of the scans and of all settings. So runs with other label budgets and seeds share it, and the
    first of them pays for it. A pre-training that was interrupted goes on from its last epoch. The work directory's
    ``pretraining.json`` says what it took, in seconds of the processor.

    Args:
        loss: Config of a loss term that reads ``features`` and views.
        cache: Folder; shared by runs.
        epochs: Over the training scans; None: as many as training has.
        crops: Fields of :class:`~rm3d_plugin.datasets.transforms.OverlappingCrops`, which take the place of the
            pipeline's :class:`AugmentedView`.
        seed: Of start and augmentation; not that of the run, which chooses the budget.
    """

    priority = 'HIGH'

    def __init__(
        self,
        loss: dict[str, Any],
        cache: str,
        epochs: int | None = None,
        crops: dict[str, Any] | None = None,
        seed: int = 0,
    ) -> None:
        if epochs is not None and epochs < 1:
            raise ValueError(f'PretrainingHook.epochs: expected at least 1, or None, got {epochs}')
        self.loss, self.cache, self.seed = loss, Path(cache) / 'pretraining', seed
        self.epochs, self.crops = epochs, {'type': 'OverlappingCrops', **(crops or {})}

    def before_train(self, runner: Runner) -> None:
        """Learn, or take what was learnt; a resumed run has it already."""
        if runner.epoch:
            return
        task = self._task(runner)
        path = self.cache / f'{content_key(VERSION, *task[:-1], _places(task.dataset))}.pth'
        if is_main_process():
            with waiting_lock(path.with_suffix('.lock')):
                self._learn(runner, task, path)
        barrier()
        state = torch.load(path, map_location='cpu', weights_only=True)
        getattr(runner.model, 'module', runner.model).backbone.load_state_dict(state['backbone'])
        if is_main_process():
            took = {'cpu_seconds': state['cpu_seconds'], 'epochs': state['epoch'], 'file': str(path)}
            write_json(Path(runner.work_dir) / RECORD, took)
            runner.logger.info(f'pre-training took {state["cpu_seconds"]:.0f} CPU seconds; its weights: {path}')

    def _task(self, runner: Runner) -> Task:
        """What is learnt in this run."""
        cfg, loader = runner.cfg, runner.cfg.train_dataloader
        network = {name: cfg.model.get(name) for name in ('type', 'backbone', 'inputs', 'heights')}
        pipeline = crop_pipeline(loader.dataset.pipeline, self.crops)
        dataset = {**loader.dataset, 'labels': 'none', 'label_store': None, 'seed': self.seed, 'pipeline': pipeline}
        length = self.epochs or runner.max_epochs
        return Task(self.loss, network, cfg.optim_wrapper, pipeline, length, loader.batch_size, self.seed, dataset)

    def _learn(self, runner: Runner, task: Task, path: Path) -> None:
        """Go through the epochs that are left."""
        with torch.random.fork_rng(devices=[]):  # the run's own draws are those of a run without pre-training
            torch.manual_seed(self.seed)
            school = _school(runner, task)
            done, seconds = _take_up(school, path)
            for epoch in range(done, task.epochs):
                torch.manual_seed(self.seed + epoch)
                watch = time.process_time()
                means = one_epoch(school, epoch)
                seconds += time.process_time() - watch
                told = ', '.join(f'{name} {value:.4f}' for name, value in means.items())
                runner.logger.info(f'pre-training, epoch {epoch + 1} of {task.epochs}: {told}')
                atomic_write(path, partial(torch.save, _state(school, epoch + 1, seconds)))


def _school(runner: Runner, task: Task) -> Schooling:
    """A new network, to be taught without heads."""
    network = Pretraining(MODELS.build({**runner.cfg.model, 'losses': [task.loss]}))
    network.to(next(runner.model.parameters()).device)
    optimizer = build_optim_wrapper(network, dict(task.optimizer))
    loader = runner.build_dataloader(
        {
            'dataset': task.dataset,
            'batch_size': task.batch_size,
            'num_workers': runner.cfg.get('num_workers', 0),
            'sampler': {'type': 'EpochSampler', 'shuffle': True, 'seed': task.seed},
            'collate_fn': {'type': 'pseudo_collate'},
        }
    )
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer.optimizer, task.epochs * len(loader))
    return Schooling(network, optimizer, schedule, loader)


def _places(dataset: Mapping[str, Any]) -> list[str]:
    """Names the points of each scan."""
    scans = DATASETS.build({**dataset, 'pipeline': []})
    return [content_key(scans.load_cloud(index).xyz) for index in range(len(scans))]


def crop_pipeline(pipeline: Sequence[Mapping[str, Any]], crops: dict[str, Any]) -> list[Mapping[str, Any]]:
    """A training pipeline with overlapping crops in the place of its views, and without steps that read labels.

    Raises:
        ConfigError: It has no :class:`AugmentedView`.
    """
    names = [step['type'] for step in pipeline]
    if VIEW not in names:
        raise ConfigError(f'PretrainingHook: expected {VIEW} among the steps of the training pipeline, got {names}')
    kept = [step for step in pipeline if step['type'] != LABELLED]
    place = [step['type'] for step in kept].index(VIEW)
    behind = [step for step in kept[place + 1 :] if step['type'] == 'PackScene']
    return [*kept[:place], crops, *behind]


def one_epoch(school: Schooling, epoch: int) -> dict[str, float]:
    """Go once through the scans; mean of each loss."""
    school.loader.sampler.set_epoch(epoch)
    school.network.train()
    sums: dict[str, float] = {}
    for batch in school.loader:
        for name, value in school.network.train_step(batch, school.optimizer).items():
            sums[name] = sums.get(name, 0.0) + float(value.detach())
        school.schedule.step()
    return {name: total / len(school.loader) for name, total in sums.items() if name != 'loss'}


def _take_up(school: Schooling, path: Path) -> tuple[int, float]:
    """Epochs that are done, and the seconds that they took."""
    if not path.is_file():
        return 0, 0.0
    state = torch.load(path, map_location='cpu', weights_only=True)
    for name, part in _parts(school):
        part.load_state_dict(state[name])
    return state['epoch'], state['cpu_seconds']


def _state(school: Schooling, epoch: int, seconds: float) -> dict[str, Any]:
    parts = {name: part.state_dict() for name, part in _parts(school)}
    return {**parts, 'backbone': school.network.network.backbone.state_dict(), 'epoch': epoch, 'cpu_seconds': seconds}


def _parts(school: Schooling) -> Iterator[tuple[str, Any]]:
    yield from (('network', school.network), ('optimizer', school.optimizer), ('schedule', school.schedule))
