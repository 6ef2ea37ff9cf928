"""How a table starts the commands of a run, and how config keys are written on a command line."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.config_files import find_config
from rm3d_plugin.engine.key_values import KeyValues

RM3D = (sys.executable, '-m', 'rm3d_plugin')


def config_path(config: str) -> Path:
    """The file of a config: the name of one that comes with RM3D, or the file itself."""
    return find_config(config)


def train_command(config: str) -> list[str]:
    """What trains by a config; further arguments follow."""
    return [*RM3D, 'train', str(config_path(config))]


def test_command(config: str, checkpoint: str) -> list[str]:
    """What scores a checkpoint by a config; further arguments follow."""
    return [*RM3D, 'test', str(config_path(config)), checkpoint]


def option_texts(options: Mapping[str, Any]) -> dict[str, str]:
    """Config keys as ``--cfg-options`` takes them: dotted key -> text.

    Raises:
        ConfigError: A value that a command line cannot carry.

    >>> option_texts({'strategy': 'paper', 'ground': None, 'merge': {'without': ['color']}})
    {'strategy': 'paper', 'ground': 'None', 'merge.without': '[color]'}
    """
    texts: dict[str, str] = {}
    for key, value in options.items():
        if isinstance(value, Mapping) and value:
            texts |= option_texts({f'{key}.{part}': item for part, item in value.items()})
        else:
            texts[key] = _text(key, value)
    return texts


def parse_options(texts: Mapping[str, str]) -> dict[str, Any]:
    """What the command makes of :func:`option_texts`: dotted key -> value."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--cfg-options', nargs='*', action=KeyValues, default={})
    arguments = ['--cfg-options', *(f'{key}={text}' for key, text in texts.items())]
    found: dict[str, Any] = parser.parse_args(arguments).cfg_options
    return found


def split_options(given: Sequence[str]) -> dict[str, str]:
    """``KEY=VALUE`` texts by their key.

    Raises:
        ConfigError: A text has no ``=``.
    """
    for text in given:
        if '=' not in text:
            raise ConfigError(f'--cfg-options: expected KEY=VALUE, got {text!r}')
    return dict(text.split('=', 1) for text in given)


def _text(key: str, value: Any) -> str:
    if isinstance(value, list):
        return f'[{",".join(_text(key, item) for item in value)}]'
    if isinstance(value, str | int | float | None) and not (isinstance(value, str) and set(value) & set(' ,[]()\'"')):
        return str(value)
    raise ConfigError(f'option {key}: expected a number, a word, None or a list of these, got {value!r}')
