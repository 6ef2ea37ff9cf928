"""Configs whose leaves are one page: top-level keys, and references to them.

A value that is exactly ``'${name}'`` becomes the top-level value ``name`` (any type; ``'${name.key}'`` goes deeper);
inside a longer string the value is written out. References are OmegaConf's, and resolved after ``--demo`` and
``--cfg-options``, so one key changes everything that uses it::

    data_root = 'data/kitti'
    train_dataloader = dict(dataset=dict(type='KittiDataset', data_root='${data_root}'))

Four names are added: ``work_dir``, ``config_name``, ``is_demo`` and ``epochs`` (= rounds * sigma, the length of
training). ``label_refreshes`` and ``num_classes`` become numbers where a config says None.
"""

import difflib
import traceback
import warnings
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

from mmengine.config import Config
from mmengine.config.utils import ConfigParsingError
from mmengine.utils import import_modules_from_strings
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from rm3d_plugin.class_names import check_class_names
from rm3d_plugin.engine.config_files import PACKAGE, find_config, pages_merge, shipped_bases, similar
from rm3d_plugin.engine.config_files import ConfigError as ConfigError
from rm3d_plugin.engine.config_pages import anchor_paths, check_names, pages
from rm3d_plugin.engine.renamed_options import HINTS, RENAMED

CHOICES = {'log_level': ('DEBUG', 'INFO', 'WARNING', 'ERROR', 'CRITICAL'), 'default_scope': (PACKAGE.name,)}
WALK, REGION_RULES = ('walker', 'random_walk'), ('propagation', 'region_prior', 'ground', 'self_training')
UNREAD = {  # by strategy of labels for points
    'default': ('merge', *REGION_RULES),
    'regions': WALK,
    'paper': (*WALK, *REGION_RULES),
}
WHOLE = (
    'batch_size',
    'accumulate',
    'checkpoint_interval',
    'val_rounds',
    'warm_up_rounds',
    'final_rounds',
    'label_refreshes',
)


def load_config(
    path: str | Path,
    work_dir: str | Path | None = None,
    demo: bool = False,
    options: Mapping[str, Any] | None = None,
) -> Config:
    """Read a config, apply the demo settings and the user's options, and resolve references.

    What comes back is what mmengine's ``Runner.from_cfg`` takes.

    Args:
        path: A config file, or one that comes with RM3D by its name: ``'rm3d_plugin::rm3d_votenet_kitti_1pct.py'``. In
            a file of your own ``_base_`` may be such a name, too.
        work_dir: Where the run leaves its files; default ``work_dirs/<config name>[_demo]``.
        demo: Merge the config's own ``demo`` dict: embedded synthetic data, a small network, few epochs.
        options: Dotted keys to values, as ``--cfg-options`` gives them; they win over the demo settings.

    Raises:
        ConfigError: The file is missing or no config, has no ``demo`` part, holds a bad reference or an option that has
            another name now; or an option names a key that the config does not have, or a part of one.
    """
    path = find_config(path)
    config = _read(path)
    overrides = config.pop('demo', None)
    if demo:
        if overrides is None:
            raise ConfigError(f'{path}: this config has no `demo` settings')
        config.merge_from_dict(overrides.to_dict())
    _apply(config, options or {})
    config.work_dir = str(work_dir or config.get('work_dir') or f'work_dirs/{path.stem}{"_demo" * demo}')
    config.config_name = path.stem
    config.is_demo = demo
    config.epochs = _count(config, 'rounds') * _count(config, 'sigma')
    if config.get('label_refreshes', 1) is None:
        longer = sum(_count(config, name) - 1 for name in ('warm_up_rounds', 'final_rounds') if name in config)
        config.label_refreshes = max(config.rounds - longer, 1)
    if 'num_classes' in config and 'class_names' in config:
        _count_classes(config)
    resolved = Config(resolve(config.to_dict(), path), filename=config.filename)
    _leave_out_none(resolved)
    for key in WHOLE:
        if key in resolved:
            _count(resolved, key)
    _check_choices(resolved)
    _check_read(resolved, options or {})
    _check_restarts(resolved)
    _import_custom_modules(resolved)
    return resolved


def _leave_out_none(config: Config) -> None:
    """Drop hooks and steps of the training pipeline that are None, as a model drops such losses."""
    dataset = (config.get('train_dataloader') or {}).get('dataset') or {}
    for holder, key in ((config, 'custom_hooks'), (config, 'train_pipeline'), (dataset, 'pipeline')):
        if isinstance(parts := holder.get(key), list):
            holder[key] = [part for part in parts if part is not None]


def resolve(config: Mapping[str, Any], path: str | Path = 'config') -> dict[str, Any]:
    """Replace references in nested dicts, lists and strings.

    Args:
        config: A whole config.
        path: Its file, for error messages.

    Raises:
        ConfigError: A reference names no key, or references go in a circle.
    """
    try:
        tree = OmegaConf.create(dict(config), flags={'allow_objects': True})
        found: dict[str, Any] = OmegaConf.to_container(tree, resolve=True)  # type: ignore[assignment]
        return found
    except OmegaConfBaseException as error:
        reason = str(error).partition('\n')[0]
        raise ConfigError(f'{path}: {error.full_key}: {reason}; top-level keys: {sorted(config)}') from error


def _read(path: Path) -> Config:
    config = read_settings(path)
    _refuse_old_names([*_dotted(config), *_dotted(config.get('demo') or {})], f'{path}: ')
    found = pages(path)
    check_names(config, found)
    anchor_paths(config, found)
    return config


def read_settings(path: Path) -> Config:
    """A page with what it goes on from, as it stands: references are not resolved, names not checked.

    Raises:
        ConfigError: The file is missing, or cannot be read as a config.
    """
    if not path.is_file():
        raise ConfigError(f'{path}: no such config{similar(path)}')
    if path.suffix != '.py':
        raise ConfigError(f'{path}: expected a .py config, got {path.suffix or "no suffix"}')
    try:
        with shipped_bases(), pages_merge():
            return Config.fromfile(str(path), import_custom_modules=False)
    except BaseException as error:  # a page is Python: it may raise anything, and stop the program, too
        _close_files(error)
        if not isinstance(error, Exception | SystemExit):
            raise
        if isinstance(error, ConfigError):
            raise ConfigError(f'{path}: {error}') from error
        reason = f'{type(error).__name__}: {error}'
        if isinstance(error, ConfigParsingError):
            reason = 'beside _base_, mmengine takes a page with `import` for one of another kind: leave the import out'
        raise ConfigError(f'{path}: cannot be read as a config ({reason})') from error


def _close_files(error: BaseException | None) -> None:
    """Close the copies of a config that mmengine leaves open where it cannot be read.

    They are variables of the functions that were left. What is raised while an error is handled hides the functions
    below: these are those of its context.
    """
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ResourceWarning)
        while error is not None:
            traceback.clear_frames(error.__traceback__)
            error = error.__context__


def _dotted(values: Mapping[str, Any], prefix: str = '') -> list[str]:
    """Every key of nested dicts: a, a.b, a.b.c, ..."""
    keys = []
    for key, value in values.items():
        keys.append(f'{prefix}{key}')
        keys += _dotted(value, f'{prefix}{key}.') if isinstance(value, Mapping) else []
    return keys


def _refuse_old_names(keys: Sequence[str], where: str) -> None:
    """Raise where a key has another name now.

    Raises:
        ConfigError: All old names, each with its new one.
    """
    told = []
    for old in dict.fromkeys(old for key in keys if (old := _old_name(key)) is not None):
        new, hint = RENAMED[old], HINTS.get(old)
        told.append(f'{old} is now {new}' * bool(new) + f'{old} is gone' * (not new) + f' ({hint})' * bool(hint))
    if told:
        raise ConfigError(where + '; '.join(told))


def _old_name(key: str) -> str | None:
    """The longest start of a dotted key that is an old name."""
    while key not in RENAMED:
        key, dot, _ = key.rpartition('.')
        if not dot:
            return None
    return key


def _apply(config: Config, options: Mapping[str, Any]) -> None:
    _refuse_old_names([key for key in options if key not in _dotted(config)], '--cfg-options ')
    unknown = unknown_options(config, options)
    if unknown:
        near = difflib.get_close_matches(unknown[0].split('.')[0], list(config), n=3)
        meant = f'did you mean {" or ".join(near)}?' if near else f'keys: {sorted(config)}'
        raise ConfigError(f'--cfg-options {", ".join(unknown)}: no such key in the config; {meant}')
    for key, value in options.items():
        try:
            with pages_merge():
                config.merge_from_dict({key: deepcopy(value)})  # mmengine takes `_delete_` out of what it is given
        except ConfigError as error:
            raise ConfigError(f'--cfg-options {key[: key.rfind(".") + 1]}{error}') from error
        except (TypeError, KeyError) as error:
            parent, _, _ = key.rpartition('.')
            raise ConfigError(
                f"--cfg-options {key}: {parent} holds no keys of its own; where it is a reference like '${{name}}', "
                'change what it refers to'
            ) from error


def _count(config: Config, key: str) -> int:
    value = config.get(key)
    if not isinstance(value, int) or value < 1:
        raise ConfigError(f'{key}: expected a whole number from 1, got {value!r}')
    return value


def _check_choices(config: Config) -> None:
    for key, choices in CHOICES.items():
        if key in config and config[key] not in choices:
            raise ConfigError(f'{key}: expected {" or ".join(choices)}, got {config[key]!r}')


def _check_read(config: Config, options: Mapping[str, Any]) -> None:
    """Whether the strategy of labels for points reads the rules that options change."""
    maker = config.get('label_maker') or {}
    strategy = maker.get('strategy', 'default')
    spreads = maker.get('type') == 'point_label_maker' and maker.get('propagate', True) and not maker.get('predicted')
    if not spreads or strategy not in UNREAD:
        return
    unread = [key for key in options if key.split('.')[0] in UNREAD[strategy] and key != 'merge.rounds']
    if unread:
        others = ' or '.join(f'strategy={name}' for name in UNREAD if unread[0].split('.')[0] not in UNREAD[name])
        raise ConfigError(f'{", ".join(unread)}: not read with strategy={strategy}; add {others}, or leave it out')


def _check_restarts(config: Config) -> None:
    """Whether the periods of a schedule with restarts are as long as training."""
    schedules = config.get('param_scheduler') or []
    for schedule in schedules if isinstance(schedules, list) else [schedules]:
        if isinstance(schedule, dict) and schedule.get('type') == 'CosineRestartLR':
            periods, weights = schedule.get('periods') or [], schedule.get('restart_weights') or [1]
            if len(weights) != len(periods) or sum(periods) < config.epochs:
                raise ConfigError(
                    f'periods={periods}, restart_weights={weights}: expected as many of both, and periods whose sum is '
                    f'that of training, rounds x sigma = {config.epochs} epochs'
                )


def _count_classes(config: Config) -> None:
    """Fill in ``num_classes`` where it is None."""
    names = config.class_names
    if not isinstance(names, list | tuple) or not names:
        raise ConfigError(f'class_names: expected a list of names, each once, got {names!r}')
    try:
        check_class_names(names, 'class_names')
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if config.num_classes is None:
        config.num_classes = len(names)
    if config.num_classes != len(names):
        raise ConfigError(
            f'num_classes={config.num_classes}: class_names has {len(names)}: {", ".join(map(str, names))}; leave '
            'num_classes out, or name as many'
        )


def unknown_options(config: Config, options: Mapping[str, Any]) -> Sequence[str]:
    """Options whose first key the config does not have (a typing error, most likely); ask before they are merged."""
    return [key for key in options if key.split('.')[0] not in config]


def _import_custom_modules(config: Config) -> None:
    """Import what ``custom_imports`` names, so that the registries know a user's own parts."""
    if not config.get('custom_imports'):
        return
    try:
        import_modules_from_strings(**config.custom_imports)
    except TypeError as error:
        raise ConfigError(
            f"custom_imports: expected dict(imports=['MODULE']), got {config.custom_imports!r}"
        ) from error
    except ImportError as error:
        raise ConfigError(
            f'custom_imports: {error}; install the package, or set PYTHONPATH to the folder that holds it'
        ) from error
