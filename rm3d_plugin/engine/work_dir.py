"""The folder of a run: one run at a time in it, nothing removed that no run wrote, resumed by its own settings."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from mmengine.config import Config
from mmengine.dist import is_main_process

from rm3d_plugin.engine.config_files import ConfigError
from rm3d_plugin.engine.hooks.safe_checkpoint_hook import latest_checkpoint
from rm3d_plugin.storage import content_of, read_json, remove_unfinished, write_json
from rm3d_plugin.storage.locks import folder_lock
from rm3d_plugin.storage.written_files import record_writes, remove_written, written_files

SETTINGS = 'settings.json'
FREE = {
    'threads', 'launcher', 'work_dir', 'resume', 'load_from', 'visualizer', 'log_level', 'log_processor', 'env_cfg',
    'default_hooks', 'num_workers', 'persistent_workers', 'pin_memory', 'prefetch_factor', 'report',
}  # fmt: skip
"""Keys that may differ in a resumed run, wherever they stand: they concern speed and reports."""
FREE_STARTS = ('val_', 'test_')


def check_folder(folder: Path, option: str = '--out') -> None:
    """Whether files can be written into a folder, which need not be there, before anything is computed for them.

    Args:
        folder: The folder.
        option: What named it, for the message.

    Raises:
        ConfigError: It is a file, lies in one, or is read-only.
    """
    for path in (folder, *folder.parents):
        if path.exists():
            if not path.is_dir():
                raise ConfigError(f'{option} {folder}: {path} is a file; name a folder')
            if not os.access(path, os.W_OK | os.X_OK):
                raise ConfigError(f'{option} {folder}: {path} is read-only; name another folder')
            return


@contextmanager
def lock_work_dir(work_dir: Path) -> Iterator[None]:
    """Keep other runs out of a work directory; of several processes the main one holds the lock.

    Raises:
        FolderInUseError: A run works there.
    """
    with folder_lock(work_dir) if is_main_process() else nullcontext():
        yield


def choose_checkpoint(work_dir: Path, resume: bool, overwrite: bool) -> Path | None:
    """The checkpoint to go on from; None: training starts from scratch.

    Raises:
        ConfigError: There are checkpoints, but neither ``resume`` nor ``overwrite`` says what becomes of them; or
            checkpoints or labels that are not known to be ours would be mistaken for those of this run.
    """
    checkpoint = latest_checkpoint(work_dir) if resume else None
    if checkpoint is not None:
        return checkpoint
    if resume:
        print(f'--resume: there is no epoch_*.pth in {work_dir}; training starts from scratch')
    known = {work_dir / name for name in written_files(work_dir)}
    found = sorted(work_dir.glob('epoch_*.pth'))
    if foreign := [path for path in (*found, *work_dir.glob('labels/round_*/complete.json')) if path not in known]:
        raise ConfigError(
            f'{foreign[0]}: no run of this version wrote it, so it is not removed, but would be taken for one of this '
            'run; name another --work-dir, or move it away'
        )
    if found and not resume and not overwrite:
        raise ConfigError(
            f'{work_dir}: holds {len(found)} checkpoints of a run ({found[-1].name}); go on with --resume, replace it '
            'with --overwrite, or name another --work-dir'
        )
    return None


def take_over(work_dir: Path, settings: Mapping[str, Any], clear: bool) -> None:
    """Make a work directory that of this run, after everything was checked.

    Args:
        work_dir: Of the run.
        settings: From :func:`plain_settings`.
        clear: Remove the files that an earlier run wrote (those of its manifest).
    """
    remove_unfinished(work_dir, '*')
    if clear:
        remove_written(work_dir)
    record_writes(work_dir)
    write_json(work_dir / SETTINGS, settings)


def plain_settings(config: Config) -> dict[str, Any]:
    """A config as JSON has it, without the place of the work directory."""
    text = json.dumps(config.to_dict(), default=str)
    settings: dict[str, Any] = json.loads(text.replace(json.dumps(str(config.work_dir))[1:-1], '<work_dir>'))
    return settings


def check_same_settings(work_dir: Path, settings: Mapping[str, Any]) -> None:
    """Whether a run is resumed with the settings that it began with; of no effect where they were not kept.

    Raises:
        ConfigError: They differ; names the keys with both values.
    """
    path = work_dir / SETTINGS
    if not path.is_file():
        return
    with content_of(path, 'the settings of a run'):
        before = leaves({**read_json(path)})
    now = leaves(settings)
    differing = sorted(key for key in {*before, *now} if before.get(key, _NONE) != now.get(key, _NONE))
    if differing:
        told = '; '.join(f'{key}: {before.get(key, _NONE)} then, {now.get(key, _NONE)} now' for key in differing[:5])
        more = f'; and {len(differing) - 5} more' if len(differing) > 5 else ''
        raise ConfigError(
            f'--resume: {work_dir} was begun with another config ({told}{more}); give the same settings, or train in '
            'another --work-dir'
        )


_NONE = '(absent)'


def leaves(settings: Any, prefix: str = '') -> dict[str, Any]:
    """Dotted key -> value of everything that must be the same in a resumed run."""
    if isinstance(settings, Mapping) and str(settings.get('type', '')).endswith('ReportHook'):
        return {}
    if not prefix or isinstance(settings, dict | list):
        items = settings.items() if isinstance(settings, Mapping) else enumerate(settings)
        out: dict[str, Any] = {}
        for key, value in items:
            name = str(key)
            if name not in FREE and not (prefix == '' and name.startswith(FREE_STARTS)):
                out |= leaves(value, f'{prefix}{name}.')
        return out
    return {prefix.rstrip('.'): settings}
