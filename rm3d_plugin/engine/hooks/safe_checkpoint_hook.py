"""Checkpoints that load with ``weights_only=True`` and are never half written."""

import json
import warnings
from itertools import chain
from pathlib import Path
from typing import Any

from mmengine.fileio import LocalBackend, register_backend
from mmengine.hooks import Hook
from mmengine.runner import Runner

from rm3d_plugin.engine.checkpoint import check_whole
from rm3d_plugin.engine.config_files import ConfigError
from rm3d_plugin.registry import HOOKS
from rm3d_plugin.storage.files import remove_unfinished, write_bytes

ATOMIC_BACKEND = 'rm3d_atomic'


@register_backend(ATOMIC_BACKEND, force=True)
class AtomicLocalBackend(LocalBackend):
    """Local files, written beside their place and moved there when complete.

    Use it with ``CheckpointHook(backend_args=dict(backend='rm3d_atomic'))``: a process killed in the middle of a write
    leaves the previous checkpoint as it was.
    """

    def put(self, obj: bytes, filepath: str | Path) -> None:
        """Write bytes atomically."""
        write_bytes(filepath, obj)


def checkpoints(work_dir: str | Path) -> dict[int, Path]:
    """Complete ``epoch_*.pth`` by their epoch, ascending."""
    found = [path for path in Path(work_dir).glob('epoch_*.pth') if path.stem.split('_')[1].isdigit()]
    return dict(sorted((int(path.stem.split('_')[1]), path) for path in found))


def forget_checkpoints(work_dir: str | Path, after: int) -> None:
    """Remove those of later epochs: they are to be trained again."""
    for epoch, path in checkpoints(work_dir).items():
        if epoch > after:
            path.unlink()


def latest_checkpoint(work_dir: str | Path) -> Path | None:
    """The whole ``epoch_*.pth`` of the highest epoch, or None.

    mmengine's ``last_checkpoint`` file is not read: a crash can leave it empty, a complete checkpoint cannot be.

    Warns:
        UserWarning: A newer one is damaged and passed over.
    """
    for path in reversed(checkpoints(work_dir).values()):
        try:
            check_whole(path)
        except ConfigError as error:
            warnings.warn(f'{error}. It is passed over.', stacklevel=2)
        else:
            return path
    return None


@HOOKS.register_module()
class SafeCheckpointHook(Hook):
    """Drop what torch refuses to load safely.

    That is the message hub's buffers, which only steady the console log, and functions in the state of schedulers
    (``OneCycleLR`` keeps one), which a resumed run has of its own.
    """

    def before_save_checkpoint(self, runner: Runner, checkpoint: dict[str, Any]) -> None:
        """Leave plain data alone; add the config, so that loading runs no code."""
        checkpoint['meta']['config_json'] = json.dumps(runner.cfg.to_dict())
        checkpoint['message_hub'] = {'log_scalars': {}, 'runtime_info': {}, 'resumed_keys': {}}
        schedulers = checkpoint.get('param_schedulers', [])
        for state in schedulers if isinstance(schedulers, list) else chain.from_iterable(schedulers.values()):
            for name in [name for name, value in state.items() if callable(value)]:
                del state[name]

    def after_load_checkpoint(self, runner: Runner, checkpoint: dict[str, Any]) -> None:
        """Leave out a config as Python text, which mmengine would run on resuming; we write none."""
        checkpoint.get('meta', {}).pop('config', None)

    def before_run(self, runner: Runner) -> None:
        """Remove parts of checkpoints that a killed run left."""
        remove_unfinished(runner.work_dir, '*.pth')
