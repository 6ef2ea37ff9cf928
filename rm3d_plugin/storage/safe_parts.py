"""A config that travelled inside a checkpoint is a stranger's: only our own parts are built from it."""

from collections.abc import Mapping
from typing import Any

from rm3d_plugin import registry
from rm3d_plugin.user_error import ConfigError

OWN = tuple(part for part in vars(registry).values() if isinstance(part, registry.PartRegistry))


def check_own_parts(config: Any, where: str) -> None:
    """Look through a config before anything is built: every ``type``, at any depth, must be a part of this project.

    mmengine takes a dotted type for the name of any Python object and calls it, and looks other names up in every
    package that ``_scope_`` names; ``Pretrained`` of its initialisers unpickles a file.

    Args:
        config: Nested mappings and sequences.
        where: Of the config, for the message.

    Raises:
        ConfigError: A part is not ours, or another scope is asked for; nothing was built.
    """
    if isinstance(config, Mapping):
        if 'type' in config:
            _check_type(config['type'], where)
        if config.get('_scope_', registry.SCOPE) != registry.SCOPE:
            raise ConfigError(f'{where}._scope_: expected {registry.SCOPE}, got {config["_scope_"]!r}')
        for key, value in config.items():
            check_own_parts(value, f'{where}.{key}')
    elif isinstance(config, list | tuple):
        for number, value in enumerate(config):
            check_own_parts(value, f'{where}[{number}]')


def check_sizes(config: Any, where: str, largest: float) -> None:
    """Look through the config of a network before it is built: no number in it may be larger than the network.

    Args:
        config: Nested mappings and sequences.
        where: Of the config, for the message.
        largest: Numbers that the weights hold; a network of more would only be built to be refused.

    Raises:
        ConfigError: A number is larger.
    """
    if isinstance(config, Mapping):
        for key, value in config.items():
            check_sizes(value, f'{where}.{key}', largest)
    elif isinstance(config, list | tuple):
        for number, value in enumerate(config):
            check_sizes(value, f'{where}[{number}]', largest)
    elif isinstance(config, int | float) and abs(config) > largest:
        raise ConfigError(f'{where}: {str(config)[:20]} is larger than the network, of at most {largest} weights')


def _check_type(name: Any, where: str) -> None:
    for part in OWN:
        part.import_from_location()
    plain = name.removeprefix(f'{registry.SCOPE}.') if isinstance(name, str) else ''
    if not any(plain in part.module_dict for part in OWN):
        raise ConfigError(
            f'{where}.type: {name!r} is no part of {registry.SCOPE}, and a checkpoint may name no other; to use a part '
            'of your own, import the module that registers it in our registries first'
        )
