"""Configs whose leaves are one page: top-level keys, and references to them.

A value that is exactly ``'${name}'`` becomes the top-level value ``name`` (any type; ``'${name.key}'`` goes deeper);
inside a longer string the value is written out. References are resolved after ``--demo`` and ``--cfg-options``, so one
key changes everything that uses it::

    data_root = 'data/kitti'
    train_dataloader = dict(dataset=dict(type='KittiDataset', data_root='${data_root}'))

Three names are added: ``work_dir``, ``config_name`` and ``epochs`` (= rounds * sigma, the length of training).
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mmengine.config import Config

_REFERENCE = re.compile(r'\$\{([\w.]+)\}')


class ConfigError(ValueError):
    """A config that cannot be run; the message names the key."""


def _lookup(name: str, names: Mapping[str, Any], path: str) -> Any:
    value: Any = names
    for key in name.split('.'):
        if not isinstance(value, Mapping) or key not in value:
            raise ConfigError(f"{path}: '${{{name}}}' names no key of the config; top-level keys: {sorted(names)}")
        value = value[key]
    return value


def resolve(value: Any, names: Mapping[str, Any], path: str = 'config', depth: int = 0) -> Any:
    """Replace references in nested dicts, lists and strings.

    Args:
        value: Any part of a config.
        names: Top-level keys that references may name.
        path: Where ``value`` stands, for error messages.
        depth: Levels of references followed so far.

    Raises:
        ConfigError: A reference names no key, or references go in a circle.
    """
    if depth > 20:
        raise ConfigError(f'{path}: references go in a circle')
    if isinstance(value, Mapping):
        return {key: resolve(item, names, f'{path}.{key}', depth) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(resolve(item, names, f'{path}[{i}]', depth) for i, item in enumerate(value))
    if not isinstance(value, str):
        return value
    whole = _REFERENCE.fullmatch(value)
    if whole:
        return resolve(_lookup(whole[1], names, path), names, path, depth + 1)
    if _REFERENCE.search(value):
        text = _REFERENCE.sub(lambda match: str(_lookup(match[1], names, path)), value)
        return resolve(text, names, path, depth + 1)
    return value


def load_config(
    path: str | Path,
    work_dir: str | Path | None = None,
    demo: bool = False,
    options: Mapping[str, Any] | None = None,
) -> Config:
    """Read a config file, apply the demo settings and the user's options, and resolve references.

    Args:
        path: A config leaf.
        work_dir: Where the run leaves its files; default ``work_dirs/<config name>[_demo]``.
        demo: Merge the config's own ``demo`` dict: embedded synthetic data, a small network, few epochs.
        options: Dotted keys to values, as ``--cfg-options`` gives them; they win over the demo settings.

    Raises:
        ConfigError: The file is missing or no config, has no ``demo`` part, or holds a bad reference; or an option
            names a key that the config does not have, or a part of one.
    """
    path = Path(path)
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
    plain = config.to_dict()
    return Config(resolve(plain, plain), filename=config.filename)


def _read(path: Path) -> Config:
    if not path.is_file():
        raise ConfigError(f'{path}: no such config; see configs/')
    if path.suffix != '.py':
        raise ConfigError(f'{path}: expected a .py config, got {path.suffix or "no suffix"}')
    try:
        return Config.fromfile(str(path))
    except (SyntaxError, NameError, FileNotFoundError, KeyError) as error:
        raise ConfigError(f'{path}: cannot be read as a config ({type(error).__name__}: {error})') from error


def _apply(config: Config, options: Mapping[str, Any]) -> None:
    unknown = unknown_options(config, options)
    if unknown:
        raise ConfigError(f'--cfg-options {", ".join(unknown)}: no such key in the config; keys: {sorted(config)}')
    for key, value in options.items():
        try:
            config.merge_from_dict({key: value})
        except (TypeError, KeyError) as error:
            parent, _, _ = key.rpartition('.')
            raise ConfigError(
                f'--cfg-options {key}: {parent} holds no keys of its own; where it is a reference like '
                "'${name}', change what it refers to"
            ) from error


def _count(config: Config, key: str) -> int:
    value = config.get(key)
    if not isinstance(value, int) or value < 1:
        raise ConfigError(f'{key}: expected a whole number from 1, got {value!r}')
    return value


def unknown_options(config: Config, options: Mapping[str, Any]) -> Sequence[str]:
    """Options whose first key the config does not have (a typing error, most likely); ask before they are merged."""
    return [key for key in options if key.split('.')[0] not in config]
