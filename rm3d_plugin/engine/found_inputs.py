"""What a config leaves to the scans: which columns their points have, and between which numbers intensities lie."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from mmengine.config import Config
from mmengine.dist import is_main_process

from rm3d_plugin.engine.config_files import ConfigError
from rm3d_plugin.registry import DATASETS, TRANSFORMS
from rm3d_plugin.structures import PointCloud, SceneError

SENSED = ('intensity', 'rgb')  # in the order in which data sets hand them out
WORDS = {'intensity': 'intensity', 'rgb': 'colour'}
OUTER = 0.1  # percent of the intensities at either end that do not count: single mirrors in the sun


class SensedScan(NamedTuple):
    """A scan, what it has of :data:`SENSED`, and the least and greatest intensity that count (0, 0: it has none)."""

    name: str
    channels: tuple[str, ...]
    low: float = 0.0
    high: float = 0.0


def sensed(name: str, cloud: PointCloud) -> SensedScan:
    """What a scan has beside places."""
    channels = {'intensity': cloud.intensity, 'rgb': cloud.colors}
    there = tuple(channel for channel in SENSED if channels[channel] is not None)
    return SensedScan(name, there, *((0.0, 0.0) if cloud.intensity is None else inner_range(cloud.intensity)))


def inner_range(intensity: Float[np.ndarray, ' points']) -> tuple[float, float]:
    """Least and greatest intensity without the outermost; (0, 1) where all are fractions.

    >>> inner_range(np.array([0.2, 0.9])), inner_range(np.arange(1001.0)), inner_range(np.array([-4.0, -4.0, 4.0]))
    ((0.0, 1.0), (0.0, 999.0), (-4.0, 3.98...))
    """
    if not len(intensity) or (intensity.min() >= 0.0 and intensity.max() <= 1.0):
        return 0.0, 1.0
    low, high = np.percentile(intensity, [OUTER, 100 - OUTER]).tolist()
    return min(low, 0.0) if intensity.min() < 0 else 0.0, high


def intensity_range(scans: Sequence[SensedScan]) -> tuple[float, float] | None:
    """Which intensities become 0 and 1; None: all are in [0, 1], or nothing is to be told apart."""
    found = [scan for scan in scans if 'intensity' in scan.channels]
    low, high = min((scan.low for scan in found), default=0.0), max((scan.high for scan in found), default=1.0)
    return None if (low, high) == (0.0, 1.0) or high <= low else (low, high)


def shared_channels(scans: Sequence[SensedScan]) -> list[str]:
    """What all scans have of :data:`SENSED`."""
    return [channel for channel in SENSED if all(channel in scan.channels for scan in scans)]


def find_inputs(config: Config) -> None:
    """Fill in what a segmentation config leaves open, say it, and check the rest, before any geometry.

    ``model.inputs.columns=None`` becomes what all scans have of intensity and colour and what the pipeline appends; a
    data set's ``intensity_range=None`` the range of its scans. Channels beyond the columns are not read.

    Args:
        config: Resolved; changed in place.

    Raises:
        ConfigError: Columns are asked for that a scan does not have, or that no transform appends.
        SceneError: A scan, or labels that scores need, cannot be read.
    """
    inputs = (config.get('model') or {}).get('inputs')
    if inputs is None or 'columns' not in inputs:
        return
    scans = list(_scans(config))
    appended = _appended(config.val_dataloader.dataset.pipeline)
    said = []
    if inputs.columns is None:
        inputs.columns = config.point_columns = [*shared_channels(scans), *appended]
        said.append(f'point_columns: {", ".join(inputs.columns)}; {_why(scans)}')
    _check(inputs.columns, appended, scans)
    limits, kept = intensity_range(scans), [name for name in SENSED if name in inputs.columns]
    for dataset in data_sets(config):
        if any(set(scan.channels) - set(kept) for scan in scans):
            dataset['channels'] = kept
        if 'intensity' in kept and limits and dataset.get('intensity_range', 0) is None:
            dataset['intensity_range'] = list(limits)
    if 'intensity' in kept and limits and config.get('intensity_range', 0) is None:
        config.intensity_range = list(limits)
        said.append(f'intensity_range: {limits[0]:g} to {limits[1]:g}, which become 0 and 1')
    if said and is_main_process():
        print('found in the scans: ' + '\n                    '.join(said), flush=True)


def take_inputs(config: Config, trained: Mapping[str, Any]) -> None:
    """Fill in what a config leaves open as a checkpoint's config has it, so that scans are read as in training.

    Args:
        config: Resolved; changed in place.
        trained: Config of the checkpoint.
    """
    inputs = (config.get('model') or {}).get('inputs')
    if inputs is None or inputs.get('columns', ()) is not None:
        return
    inputs.columns = config.point_columns = list(trained['model']['inputs']['columns'])
    known = trained['val_dataloader']['dataset']
    for dataset in data_sets(config):
        dataset.update({name: known[name] for name in ('channels', 'intensity_range') if name in known})


def data_sets(node: Any) -> Iterator[dict[str, Any]]:
    """Every data set's config in a config, at any depth: what has a type and a pipeline."""
    if isinstance(node, Mapping | Config):
        if 'type' in node and 'pipeline' in node:
            yield node  # type: ignore[misc]
        for value in node.values():
            yield from data_sets(value)
    elif isinstance(node, list | tuple):
        for value in node:
            yield from data_sets(value)


def _scans(config: Config) -> Iterator[SensedScan]:
    """Scans that are learnt from and that are scored; of data sets whose scans are all alike the first."""
    told = set()
    for name in ('train_dataloader', 'val_dataloader'):
        if config.get(name) is None:
            continue
        dataset = DATASETS.build({**config[name].dataset, 'pipeline': []})
        for index, scene in enumerate(dataset.scene_ids[: 1 if dataset.alike else None]):
            place = str(dataset.path(index)) if not dataset.alike else f'{dataset.data_root}: {scene}'
            if dataset.labels == 'truth':
                dataset.check_scene(index)
            if place not in told:
                told.add(place)
                yield sensed(scene, dataset.load_cloud(index))


def _appended(pipeline: Sequence[Mapping[str, Any]]) -> list[str]:
    """Columns that transforms append, in their order."""
    kinds = [TRANSFORMS.get(step['type']) for step in pipeline]
    return [kind.column for kind in kinds if hasattr(kind, 'column')]


def _why(scans: Sequence[SensedScan]) -> str:
    shared, words = shared_channels(scans), [f'in {len(scans)} scans']
    for channel in SENSED:
        without = [scan.name for scan in scans if channel not in scan.channels]
        if channel not in shared and len(without) < len(scans):
            words.append(f'{WORDS[channel]} is left out, since {without[0]} has none')
    return '; '.join(words)


def _check(columns: Sequence[str], appended: Sequence[str], scans: Sequence[SensedScan]) -> None:
    for scan in scans:
        lacking = [name for name in SENSED if name in columns and name not in scan.channels]
        if lacking:
            raise SceneError(
                f'scene {scan.name}: has no {WORDS[lacking[0]]}, but point_columns={list(columns)} asks for '
                f'{lacking[0]}; leave it out, or the scan (point_columns=None: what all scans have)'
            )
    if [name for name in columns if name not in SENSED] != list(appended):
        raise ConfigError(
            f'point_columns={list(columns)}: eval_pipeline appends {list(appended) or "nothing"} to the points; '
            'name what it appends, in that order'
        )
