"""A trained network with what its run knew, from its checkpoint alone."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from mmengine.config import Config
from mmengine.registry import init_default_scope

from rm3d_plugin.engine.checkpoint import load_weights, read_checkpoint
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.registry import MODELS, SCOPE, TRANSFORMS
from rm3d_plugin.storage.files import MALFORMED
from rm3d_plugin.storage.safe_parts import check_own_parts, check_sizes
from rm3d_plugin.user_error import UserError

_SMALL = 1 << 20  # a size that is no danger, however small the network


@dataclass(frozen=True, eq=False)
class TrainedNetwork:
    """A network that is ready to predict.

    Attributes:
        model: The network, in evaluation mode.
        pipeline: Transforms of its validation scenes.
        config: Of its run, resolved.
        classes: Names of the classes; () where the run named none.
    """

    model: Any
    pipeline: list[Any]
    config: Config
    classes: tuple[str, ...]


def load_network(checkpoint: str | Path, device: str = 'cpu') -> TrainedNetwork:
    """Rebuild a network from a checkpoint of this project; the config travels inside as plain data.

    Raises:
        ConfigError: No such file or device, a checkpoint of another program, or one whose config names other parts than
            our own.
    """
    state = read_checkpoint(checkpoint)
    if not isinstance(state.get('meta'), dict) or 'config_json' not in state['meta']:
        raise ConfigError(f'{checkpoint}: holds no config; expected a checkpoint of `rm3d train`')
    config = _config_of(state, checkpoint)
    dataset = config.val_dataloader.dataset
    check_own_parts(config.model, f'{checkpoint}: model')
    check_own_parts(dataset.pipeline, f'{checkpoint}: pipeline')
    held = sum(weight.numel() for weight in state['state_dict'].values())
    sizes = {key: value for key, value in config.model.items() if key != 'inference'}  # what may be larger: chunks
    check_sizes(sizes, f'{checkpoint}: model', max(held, _SMALL))
    init_default_scope(SCOPE)
    with _parts_of(checkpoint):
        model = MODELS.build(config.model)
        load_weights(model, state, checkpoint)
        pipeline = [TRANSFORMS.build(step) for step in _without_folders(dataset.pipeline)]
        names = dataset.get('classes') or (state['meta'].get('dataset_meta') or {}).get('classes') or ()
        classes = tuple(map(str, names))
    return TrainedNetwork(model.to(find_device(device)).eval(), pipeline, config, classes)


def _config_of(state: dict[str, Any], checkpoint: str | Path) -> Config:
    try:
        config = Config(json.loads(state['meta']['config_json']))
    except (ValueError, TypeError, RecursionError) as error:
        raise ConfigError(f'{checkpoint}: its config is damaged ({error}); copy it again') from error
    with _parts_of(checkpoint):
        whole = isinstance(config.get('model'), dict) and isinstance(config.val_dataloader.dataset.pipeline, list)
    if not whole:
        raise ConfigError(f'{checkpoint}: its config has no model or no val_dataloader with a pipeline')
    return config


def _without_folders(config: Any) -> Any:
    """The same parts without a ``cache``: a checkpoint does not choose a folder that is written to."""
    if isinstance(config, Mapping):
        return {name: None if name == 'cache' else _without_folders(value) for name, value in config.items()}
    return [_without_folders(value) for value in config] if isinstance(config, list | tuple) else config


@contextmanager
def _parts_of(checkpoint: str | Path) -> Iterator[None]:
    """Within it, the parts that a checkpoint's config names are built."""
    try:
        yield
    except UserError:
        raise
    except (*MALFORMED, AssertionError, RuntimeError, MemoryError) as error:
        raise ConfigError(
            f'{checkpoint}: its config cannot be built ({type(error).__name__}: {error}); copy it again, or use the '
            'version that wrote it'
        ) from error


def find_device(name: str) -> torch.device:
    """The device of that name.

    Raises:
        ConfigError: There is none.
    """
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise ConfigError(f'--device {name}: no such device; expected cpu, cuda, cuda:1 ...') from error
    if device.type == 'cuda' and (device.index or 0) >= torch.cuda.device_count():
        raise ConfigError(f'--device {name}: {torch.cuda.device_count()} CUDA devices were found; use --device cpu')
    return device
