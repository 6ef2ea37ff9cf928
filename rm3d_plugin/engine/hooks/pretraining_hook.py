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
RECORD = 'pretraining.json'


class Schooling(NamedTuple):
    """What is learnt: network and optimizer, its steps, and the batches of an epoch."""

    network: Pretraining
    optimizer: Any
    schedule: torch.optim.lr_scheduler.LRScheduler
    loader: Any


@HOOKS.register_module()
class PretrainingHook(Hook):
    """Before training, the backbone learns by a loss on two overlapping crops of each scan; no label is read.

    What was learnt lies in a cache under a name of the scans and of all settings. So runs with other label budgets and
    seeds share it, and the first of them pays for it. A pre-training that was interrupted goes on from its last epoch.
    The work directory's ``pretraining.json`` says what it took, in seconds of the processor.

    Args:
        loss: Config of a loss term that reads ``features`` and views.
        dataset: Config of the training scans; its labels and its pipeline are left out.
        pipeline: That of training; its :class:`AugmentedView` gives way to ``crops``.
        epochs: Over the training scans.
        batch_size: Scans a step.
        cache: Folder; shared by runs.
        crops: Fields of :class:`~rm3d_plugin.datasets.transforms.OverlappingCrops`.
        seed: Of start and augmentation; not that of the run, which chooses the budget.
    """

    priority = 'HIGH'

    def __init__(
        self,
        loss: dict[str, Any],
        dataset: dict[str, Any],
        pipeline: Sequence[dict[str, Any] | None],
        epochs: int,
        batch_size: int,
        cache: str,
        crops: dict[str, Any] | None = None,
        seed: int = 0,
    ) -> None:
        if epochs < 1 or batch_size < 1:
            raise ValueError(f'PretrainingHook: expected epochs and batch_size >= 1, got {epochs} and {batch_size}')
        self.loss, self.epochs, self.batch_size, self.seed = loss, epochs, batch_size, seed
        self.cache = Path(cache) / 'pretraining'
        steps = crop_pipeline(pipeline, {'type': 'OverlappingCrops', **(crops or {})})
        self.dataset = {**dataset, 'labels': 'none', 'label_store': None, 'seed': seed, 'pipeline': steps}

    def before_train(self, runner: Runner) -> None:
        """Learn, or take what was learnt; a resumed run has it already."""
        if runner.epoch:
            return
        path = self.cache / f'{self._key(runner.cfg)}.pth'
        if is_main_process():
            with waiting_lock(path.with_suffix('.lock')):
                self._learn(runner, path)
        barrier()
        state = torch.load(path, map_location='cpu', weights_only=True)
        getattr(runner.model, 'module', runner.model).backbone.load_state_dict(state['backbone'])
        if is_main_process():
            took = {'cpu_seconds': state['cpu_seconds'], 'epochs': state['epoch'], 'file': str(path)}
            write_json(Path(runner.work_dir) / RECORD, took)
            runner.logger.info(f'pre-training took {state["cpu_seconds"]:.0f} CPU seconds; its weights: {path}')

    def _key(self, cfg: Mapping[str, Any]) -> str:
        """Names what is learnt: settings, network and scans."""
        scans = DATASETS.build({**self.dataset, 'pipeline': []})
        places = [content_key(scans.load_cloud(index).xyz) for index in range(len(scans))]
        network = {name: cfg['model'].get(name) for name in ('type', 'backbone', 'inputs', 'heights')}
        how = {'optimizer': cfg['optim_wrapper'], 'epochs': self.epochs, 'batch': self.batch_size, 'seed': self.seed}
        return content_key(VERSION, self.loss, self.dataset['pipeline'], network, how, places)

    def _learn(self, runner: Runner, path: Path) -> None:
        """Go through the epochs that are left."""
        with torch.random.fork_rng(devices=[]):  # the run's own draws are those of a run without pre-training
            torch.manual_seed(self.seed)
            school = self._school(runner)
            done, seconds = _take_up(school, path)
            for epoch in range(done, self.epochs):
                torch.manual_seed(self.seed + epoch)
                watch = time.process_time()
                means = one_epoch(school, epoch)
                seconds += time.process_time() - watch
                told = ', '.join(f'{name} {value:.4f}' for name, value in means.items())
                runner.logger.info(f'pre-training, epoch {epoch + 1} of {self.epochs}: {told}')
                atomic_write(path, partial(torch.save, _state(school, epoch + 1, seconds)))

    def _school(self, runner: Runner) -> Schooling:
        network = Pretraining(MODELS.build({**runner.cfg.model, 'losses': [self.loss]}))
        network.to(next(runner.model.parameters()).device)
        optimizer = build_optim_wrapper(network, dict(runner.cfg.optim_wrapper))
        loader = runner.build_dataloader(
            {
                'dataset': self.dataset,
                'batch_size': self.batch_size,
                'num_workers': runner.cfg.get('num_workers', 0),
                'sampler': {'type': 'EpochSampler', 'shuffle': True, 'seed': self.seed},
                'collate_fn': {'type': 'pseudo_collate'},
            }
        )
        steps = self.epochs * len(loader)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer.optimizer, steps)
        return Schooling(network, optimizer, schedule, loader)


def crop_pipeline(pipeline: Sequence[dict[str, Any] | None], crops: dict[str, Any]) -> list[dict[str, Any]]:
    """A training pipeline with overlapping crops in the place of its augmented view, and no other view.

    Raises:
        ConfigError: It has no :class:`AugmentedView`.
    """
    names = [step['type'] if step else None for step in pipeline]
    if VIEW not in names:
        raise ConfigError(f'PretrainingHook.pipeline: expected {VIEW} among its steps, got {names}')
    first = names.index(VIEW)
    views = {number for number, name in enumerate(names) if name == VIEW and number != first}
    left = ((number, step) for number, step in enumerate(pipeline) if step and number not in views)
    return [crops if number == first else step for number, step in left]


def one_epoch(school: Schooling, epoch: int) -> dict[str, float]:
    """Go once through the scans; mean of each loss."""
    school.loader.sampler.set_epoch(epoch)
    school.network.train()
    sums: dict[str, float] = {}
    for batch in school.loader:
        for name, value in school.network.train_step(batch, school.optimizer).items():
            sums[name] = sums.get(name, 0.0) + float(value)
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
