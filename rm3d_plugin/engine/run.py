"""From a resolved config to a run: train, prepare, score."""

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

from mmengine.config import Config
from mmengine.dist import barrier, is_main_process
from mmengine.runner import Runner

from rm3d_plugin.engine.checkpoint import load_weights, read_checkpoint
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.config_errors import config_errors
from rm3d_plugin.engine.distributed import use_launcher
from rm3d_plugin.engine.found_inputs import find_inputs, take_inputs
from rm3d_plugin.engine.hooks.safe_checkpoint_hook import checkpoints
from rm3d_plugin.engine.screen import QuietRunner
from rm3d_plugin.engine.work_dir import (
    check_folder,
    check_same_settings,
    choose_checkpoint,
    lock_work_dir,
    plain_settings,
    take_over,
)
from rm3d_plugin.evaluation.records import ScoreRecord, records_of
from rm3d_plugin.ops import _parallel
from rm3d_plugin.registry import DATASETS, TASK_UTILS
from rm3d_plugin.storage import write_json
from rm3d_plugin.storage.written_files import record_writes

DEMO_NOTE = 'Demo data: the scenes are synthetic, scanned by virtual sensors; scores say nothing of real scans.'


def set_threads(count: int) -> None:
    """Threads of our kernels; 0 = one for each core this process may use. Torch's own operations take one thread.

    Raises:
        ConfigError: The number is negative.
    """
    if not isinstance(count, int) or count < 0:
        raise ConfigError(f'threads: expected a whole number from 0 (all cores), got {count!r}')
    _parallel.set_threads(count or _parallel.free_cores())


def train(
    config: Config,
    resume: bool = False,
    amp: bool = False,
    launcher: str = 'none',
    overwrite: bool = False,
    add_clicks: bool = False,
) -> Path:
    """Train by a resolved config; returns the work directory.

    Everything is checked first. Then the files that an earlier run wrote there are removed (``overwrite``), and no
    others.

    Args:
        config: See :func:`rm3d_plugin.engine.config.load_config`.
        resume: Go on from the newest whole checkpoint.
        amp: Mixed precision.
        launcher: Of several processes.
        overwrite: The work directory may hold the checkpoints of another run, which are removed.
        add_clicks: With ``resume``, go on with clicks that were added to the budget's file: from the newest checkpoint
            at which a round of labels begins, which is made again with all clicks.

    Raises:
        SceneError, ConfigError: Data or config cannot be used, the work directory is in use or holds a run, or
            ``resume`` is asked for with another config.
    """
    if add_clicks and not resume:
        raise ConfigError('--add-clicks: goes with --resume; a run that starts reads all clicks anyway')
    if launcher != 'none':
        use_launcher(config, launcher)
    if amp:
        use_amp(config)
    check_data(config, 'train_dataloader', 'val_dataloader')
    with config_errors(config):
        find_inputs(config)
    work_dir = Path(config.work_dir)
    with lock_work_dir(work_dir):
        checkpoint = choose_checkpoint(work_dir, resume, overwrite)
        settings = plain_settings(config)
        if checkpoint is not None:
            check_same_settings(work_dir, settings)
            checkpoint = prepare_to_add_clicks(config, work_dir) if add_clicks else checkpoint
            read_checkpoint(checkpoint)  # refuses weights that make no sense
            config.resume, config.load_from = True, str(checkpoint)
        barrier()
        os.environ.setdefault('CUBLAS_WORKSPACE_CONFIG', ':4096:8')  # without it products on a GPU vary between runs
        with config_errors(config):
            runner = QuietRunner.from_cfg(config)
            build_loops(runner)
        if is_main_process():
            take_over(work_dir, settings, clear=checkpoint is None)
        barrier()
        record_writes(work_dir)
        runner.train()
    return work_dir


def prepare_to_add_clicks(config: Config, work_dir: Path) -> Path:
    """Tell the label source that clicks may be added; the newest checkpoint at which a round of labels begins.

    Raises:
        ConfigError: There is no such checkpoint.
    """
    (hook,) = label_hooks(config, 'no labels are made')
    hook.label_maker.source.add_clicks = True
    begin = hook.interval * hook.get('warm_up_rounds', 1)
    starts = range(begin, begin + hook.interval * (hook.rounds - 1), hook.interval)
    found = [path for epoch, path in checkpoints(work_dir).items() if epoch in starts]
    if not found:
        raise ConfigError(
            f'--add-clicks: {work_dir} has no checkpoint of an epoch at which a round of labels begins '
            f'({", ".join(map(str, starts))}); checkpoint_interval={hook.interval} keeps them. Start without --resume'
        )
    return found[-1]


def label_hooks(config: Config, so_that: str) -> list[Any]:
    """Configs of the hooks that make labels.

    Raises:
        ConfigError: There are none.
    """
    hooks = [hook for hook in config.custom_hooks if hook.type.endswith('RegionMergeHook')]
    if not hooks:
        raise ConfigError(f'{config.config_name}: no RegionMergeHook among custom_hooks, so {so_that}')
    return hooks


def check_data(config: Config, *dataloaders: str) -> None:
    """Look for the scenes of some dataloaders and at the cache's folder before anything else is built.

    Raises:
        DatasetNotFoundError, SceneError, ConfigError: They are not there or cannot be used, or are asked for wrongly.
    """
    for name in dataloaders:
        if config.get(name) is not None:
            with config_errors(config):
                dataset = DATASETS.build({**config[name].dataset, 'pipeline': []})
            dataset.find_scenes()
    cache = config.get('cache_dir')
    if cache is not None and not Path(cache).is_dir():  # one that is there may hold all there is to read
        check_folder(Path(cache), 'cache_dir')


def build_loops(runner: Runner) -> None:
    """Build what mmengine leaves until training (loops, dataloaders, optimizer, schedules): what is wrong is told now.

    Args:
        runner: Whose ``train`` follows.

    Raises:
        ConfigError: The model has no loss, or there is no such optimizer.
    """
    if not len(getattr(getattr(runner.model, 'module', runner.model), 'losses', [None])):
        raise ConfigError('losses: the list is empty, or all of it is None: nothing can be learnt')
    _ = runner.train_loop
    if runner.cfg.get('val_dataloader') is not None:
        _ = runner.val_loop
    check_optimizer(runner.cfg)
    runner.optim_wrapper = runner.build_optim_wrapper(runner.optim_wrapper)
    if runner.param_schedulers is not None:
        runner.param_schedulers = runner.build_param_scheduler(runner.param_schedulers)


def check_optimizer(config: Config) -> None:
    """Look for the optimizer, of which mmengine says nothing.

    Raises:
        ConfigError: There is none of that name.
    """
    from mmengine.registry import OPTIMIZERS

    kind = config.get('optim_wrapper', {}).get('optimizer', {}).get('type')
    if isinstance(kind, str) and OPTIMIZERS.get(kind) is None:
        known = ', '.join(sorted(OPTIMIZERS.module_dict))
        raise ConfigError(f'optim_wrapper.optimizer.type: expected one of {known}; got {kind!r}')


def prepare(config: Config, jobs: int = 1) -> None:
    """Fill the geometry cache of the training scenes.

    Raises:
        ConfigError: The config has no hook that makes labels.
    """
    hooks = label_hooks(config, 'there is nothing to prepare')
    check_data(config, 'label_dataloader')
    with config_errors(config):
        label_maker = TASK_UTILS.build(hooks[0].label_maker)
    print(label_maker.prepare(jobs))


def use_amp(config: Config) -> None:
    """Switch to mixed precision: half precision with a scaled loss on a GPU, bfloat16 on a CPU."""
    import torch

    if not torch.cuda.is_available():
        import rm3d_plugin.engine.autocast  # noqa: F401  (registers it)

        config.optim_wrapper.type = 'CPUAutocastOptimWrapper'
        return
    config.optim_wrapper.type = 'AmpOptimWrapper'
    config.optim_wrapper.loss_scale = 'dynamic'


class Evaluation(NamedTuple):
    """Scores of a checkpoint: the flat numbers, and the records that the metrics handed on."""

    scores: dict[str, Any]
    records: tuple[ScoreRecord, ...]


def evaluate(config: Config, checkpoint: str | Path) -> Evaluation:
    """Score a checkpoint on the validation scenes; writes the flat numbers to ``test_metrics.json``.

    Raises:
        ConfigError: The checkpoint cannot be read, or is of another model.
        SceneError: The data cannot be used.
    """
    state = read_checkpoint(checkpoint)
    check_data(config, 'test_dataloader')
    with config_errors(config):
        if 'config_json' in state.get('meta', {}):
            take_inputs(config, json.loads(state['meta']['config_json']))
        else:
            find_inputs(config)
    config.custom_hooks = []
    with config_errors(config):
        runner = QuietRunner.from_cfg(config)
    load_weights(runner.model, state, checkpoint)
    scores: dict[str, Any] = runner.test()
    write_json(Path(config.work_dir) / 'test_metrics.json', scores)
    return Evaluation(scores, records_of(runner.test_evaluator))
