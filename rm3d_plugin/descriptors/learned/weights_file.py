"""Trained networks of descriptors as files: checkpoints of ``rm3d train``, and small archives without pickle."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from rm3d_plugin.registry import MODELS
from rm3d_plugin.storage.checkpoint import load_weights, read_checkpoint
from rm3d_plugin.storage.files import MALFORMED, DamagedFileError, read_npz, write_npz
from rm3d_plugin.storage.safe_parts import check_own_parts, check_sizes
from rm3d_plugin.user_error import ConfigError, UserError

SHIPPED = Path(__file__).parent / 'weights'
_CONFIG = 'config'  # of the network, JSON as bytes; the other arrays are weights by name
_SMALL = 1 << 20  # a size that is no danger, however small the network
_MAKE = 'expected a checkpoint of `rm3d train` by a config of configs/descriptors, or its descriptor.npz'


class TrainedWeights(NamedTuple):
    """A network as data.

    Attributes:
        model: Config of the network; its losses are left out.
        arrays: Weights by name.
    """

    model: dict[str, Any]
    arrays: dict[str, np.ndarray]


def write_weights(path: Path, model: dict[str, Any], state: dict[str, torch.Tensor]) -> Path:
    """Write an archive; weights become half precision, which halves it and moves descriptors by about 1e-3.

    Args:
        path: ``.npz``.
        model: Config of the network.
        state: Its weights; those of losses are left out.
    """
    kept = {name: value for name, value in state.items() if not name.startswith('losses.')}
    arrays = {name: value.cpu().numpy() for name, value in kept.items()}
    small = {name: value.astype(np.float16) if value.dtype == np.float32 else value for name, value in arrays.items()}
    text = json.dumps(_without_losses(model), sort_keys=True)
    return write_npz(path, {_CONFIG: np.frombuffer(text.encode(), dtype=np.uint8), **small})


def read_weights(path: str | Path) -> TrainedWeights:
    """Read a checkpoint or an archive; no code in it is run.

    Raises:
        ConfigError: No such file, a damaged one, one that holds something else, or one that names parts of others.
    """
    path = Path(path)
    if not path.is_file():
        raise ConfigError(f'{path}: no such checkpoint; {_MAKE}')
    try:
        found = _read_npz(path) if path.suffix == '.npz' else _read_pth(path)
    except DamagedFileError as error:
        raise ConfigError(f'{error}; {_MAKE}') from error
    except UserError:
        raise
    except (*MALFORMED, OSError) as error:
        raise ConfigError(f'{path}: holds no trained descriptor ({type(error).__name__}: {error}); {_MAKE}') from error
    check_own_parts(found.model, f'{path}: model')
    check_sizes(found.model, f'{path}: model', max(sum(value.size for value in found.arrays.values()), _SMALL))
    return found


def build_network(weights: TrainedWeights, path: str | Path) -> torch.nn.Module:
    """The network, in evaluation mode.

    Raises:
        ConfigError: It cannot be built, or the weights are of another one.
    """
    try:
        network: torch.nn.Module = MODELS.build(weights.model)
    except UserError:
        raise
    except (*MALFORMED, AssertionError, RuntimeError, MemoryError) as error:
        raise ConfigError(f'{path}: its network cannot be built ({type(error).__name__}: {error}); {_MAKE}') from error
    state = {name: torch.from_numpy(np.array(value)) for name, value in weights.arrays.items()}
    load_weights(network, {'state_dict': state}, path)
    return network.eval()


def _read_npz(path: Path) -> TrainedWeights:
    arrays = read_npz(path)
    model = json.loads(arrays.pop(_CONFIG).tobytes().decode())
    _check_finite(arrays, path)
    return TrainedWeights(_checked(model), arrays)


def _read_pth(path: Path) -> TrainedWeights:
    state = read_checkpoint(path)
    model = json.loads(state['meta']['config_json'])['model']
    kept = {name: value.numpy() for name, value in state['state_dict'].items() if not name.startswith('losses.')}
    return TrainedWeights(_checked(model), kept)


def _checked(model: Any) -> dict[str, Any]:
    if not isinstance(model, dict) or not isinstance(model.get('type'), str):
        raise TypeError('model: expected the config of a network')
    return _without_losses(model)


def _without_losses(model: dict[str, Any]) -> dict[str, Any]:
    return {**model, 'losses': []}


def _check_finite(arrays: dict[str, np.ndarray], path: Path) -> None:
    for name, value in arrays.items():
        if not np.isfinite(value).all():
            raise ConfigError(f'{path}: weight {name} is NaN or infinite; copy it again')
