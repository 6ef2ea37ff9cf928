"""Checkpoints as files that a user names: read safely, or refused with a reason."""

import zipfile
import zlib
from pathlib import Path
from typing import Any

import torch

from rm3d_plugin.user_error import ConfigError

_ABSURD = 1e20  # no weight of a trained network is near it


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """Read a checkpoint of this project; no code in it is run.

    Raises:
        ConfigError: No such file, a damaged one, or one that holds no weights, NaN among them, or text to be run.
    """
    path = Path(path)
    if not path.is_file():
        raise ConfigError(f'{path}: no such checkpoint')
    check_whole(path)
    try:
        state = torch.load(path, map_location='cpu', weights_only=True)
    except Exception as error:  # foreign bytes show as anything from UnpicklingError to EOFError
        reason = str(error).partition('\n')[0]
        raise ConfigError(f'{path}: not a checkpoint that loads safely ({type(error).__name__}: {reason})') from error
    if not isinstance(state, dict) or not isinstance(state.get('state_dict'), dict):
        raise ConfigError(f'{path}: holds no weights; expected a checkpoint of `rm3d train`')
    if 'config' in state.get('meta', ()):
        raise ConfigError(
            f'{path}: meta.config holds a config as Python text, which would run; no run of this project writes it'
        )
    for name, value in state['state_dict'].items():
        if not isinstance(value, torch.Tensor) or not _is_sane(value):
            raise ConfigError(f'{path}: weight {name} is NaN, infinite or absurdly large; use an earlier checkpoint')
    return state


def check_whole(path: Path) -> None:
    """Compare a checkpoint with the checksums that torch keeps beside each of its tensors.

    Raises:
        ConfigError: It is cut off or altered, or may not be read.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
    except PermissionError as error:
        raise ConfigError(f'{path}: cannot be read ({error.strerror})') from error
    except (OSError, zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise ConfigError(
            f'{path}: not a checkpoint that loads safely ({type(error).__name__}: {error}); cut off or foreign'
        ) from error
    if damaged is not None:
        raise ConfigError(f'{path}: {damaged} does not fit its checksum: damaged; use an earlier checkpoint')


def _is_sane(value: torch.Tensor) -> bool:
    return not value.is_floating_point() or bool((value.abs() <= _ABSURD).all())  # NaN compares as False


def load_weights(model: torch.nn.Module, state: dict[str, Any], path: str | Path) -> None:
    """Put a checkpoint's weights into a model, all of them.

    Raises:
        ConfigError: They are of another model.
    """
    try:
        model.load_state_dict(state['state_dict'])
    except RuntimeError as error:
        reasons = [line.strip() for line in str(error).splitlines()[1:3]]
        raise ConfigError(
            f'{path}: its weights do not fit the model; pass the config and the options of its training '
            f'({" ".join(reasons)})'
        ) from error
