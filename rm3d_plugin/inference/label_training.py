"""A network trained on scans of which few points are labelled, within a given time: what `rm3d label --train` adds."""

import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mmengine.config import Config
from mmengine.registry import init_default_scope

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.found_inputs import sensed, shared_channels
from rm3d_plugin.engine.hooks.safe_checkpoint_hook import latest_checkpoint
from rm3d_plugin.engine.run import set_threads, train
from rm3d_plugin.inference.given_labels import GivenLabels
from rm3d_plugin.inference.label_files import LabelledFiles
from rm3d_plugin.inference.predict_points import PointOptions, Segmenter
from rm3d_plugin.inference.scan_kind import Kind
from rm3d_plugin.inference.trained import load_network
from rm3d_plugin.registry import SCOPE
from rm3d_plugin.storage import Click, read_json, write_clicks, write_text

ROUNDS = 3  # of training, as in the configs; one where the time is short
PACE_EPOCHS = 3  # that are trained to measure one; the first, which compiles, does not count
USED = 0.9  # share of the time that is planned for
LEAST_EPOCHS = 5  # fewer are no training
CHECKPOINT_SECONDS = 5.0  # between checkpoints, about
OWN = ('shape', 'place')  # columns of the configs beside the sensor's


@dataclass(frozen=True)
class TrainingOptions:
    """How long and by what a network is trained.

    Attributes:
        minutes: Of all that is added to the first labels.
        config: Keys of the config, dotted -> value; they win.
        place: The network is told where in its scan a point lies. True for scans that it learns from; False where it
            shall predict others, too.
    """

    minutes: float
    config: Mapping[str, Any] = field(default_factory=dict)
    place: bool = True

    def __post_init__(self) -> None:
        if not self.minutes > 0:
            raise ConfigError(f'--train: expected minutes > 0, got {self.minutes:g}')


class Pace(NamedTuple):
    """Seconds of an epoch, and of what comes with a round beside: labels, predictions, validation."""

    epoch: float
    beside: float


class Schedule(NamedTuple):
    """Rounds of so many epochs each."""

    rounds: int
    sigma: int


def plan_schedule(seconds: float, pace: Pace) -> Schedule:
    """As many epochs as fit, in three rounds where half of the time and more is left for training, else in one.

    >>> plan_schedule(100.0, Pace(epoch=1.0, beside=10.0))
    Schedule(rounds=3, sigma=20)
    >>> plan_schedule(50.0, Pace(epoch=1.0, beside=10.0))
    Schedule(rounds=1, sigma=30)

    Args:
        seconds: That are left; the labels after the last round need as long as those before.
        pace: Measured.

    Raises:
        ConfigError: The time is too short.
    """
    for rounds in (ROUNDS, 1):
        left = seconds - (rounds + 1) * pace.beside
        sigma = int(left / pace.epoch / rounds)
        if sigma >= LEAST_EPOCHS and (rounds == 1 or left >= seconds / 2):
            return Schedule(rounds, sigma)
    needed = (PACE_EPOCHS + LEAST_EPOCHS) * pace.epoch + 3 * pace.beside
    raise ConfigError(
        f'--train: the time is too short: an epoch takes {pace.epoch:.1f} s, labels and predictions '
        f'{pace.beside:.1f} s; give at least {np.ceil(needed / USED / 6) / 10:.1f} minutes; the first labels stand'
    )


def train_network(
    files: LabelledFiles, kind: Kind, folder: Path, options: TrainingOptions, began: float
) -> tuple[Segmenter, Config]:
    """Train by the config of the kind for as long as there is time, and return the network with its config.

    Args:
        files: The scans and their labels.
        kind: Of the scans.
        folder: Receives the inputs, the run in ``run``, and caches.
        options: How long.
        began: When the time began, of :func:`time.monotonic`.

    Raises:
        ConfigError: The time is too short, or an option is wrong.
        SceneError: A scan cannot be used.
    """
    own = _inputs(files, folder, options.place)
    until = began + 60 * options.minutes
    pace = _measure(kind, folder / 'pace', own | dict(options.config))
    schedule = plan_schedule(USED * (until - time.monotonic()), pace)
    config = _config(kind, folder / 'run', own | _epochs(*schedule, pace.epoch) | dict(options.config))
    config.custom_hooks.append({'type': 'TimeBudgetHook', 'seconds': max(until - time.monotonic() - pace.beside, 1.0)})
    train(config)
    checkpoint = latest_checkpoint(folder / 'run')
    if checkpoint is None:
        raise ConfigError(f'{folder / "run"}: the time was over before a checkpoint was written; give more minutes')
    return Segmenter.from_network(load_network(checkpoint), PointOptions(columns=files.options.columns)), config


def _measure(kind: Kind, folder: Path, settings: Mapping[str, Any]) -> Pace:
    """Train a few epochs; what is cached on the way is of use to the run."""
    shutil.rmtree(folder, ignore_errors=True)
    began = time.monotonic()
    train(_config(kind, folder, dict(settings) | _epochs(1, PACE_EPOCHS, CHECKPOINT_SECONDS)))
    taken = time.monotonic() - began
    epochs = [entry['wall'] for entry in read_json(folder / 'timing.json')['epochs'].values()]
    shutil.rmtree(folder)
    return Pace(float(np.mean(epochs[1:])), max(taken - sum(epochs), 0.0))


def _config(kind: Kind, work_dir: Path, settings: Mapping[str, Any]) -> Config:
    config = load_config(f'rm3d_sem_files_{kind}_clicks', work_dir, options=settings)
    config.custom_hooks = [hook for hook in config.custom_hooks if hook.type != 'ReportHook']  # it takes as long again
    set_threads(int(config.threads))
    init_default_scope(SCOPE)
    return config


def _epochs(rounds: int, sigma: int, epoch_seconds: float) -> dict[str, Any]:
    """Keys of a schedule; the set of labels that is made of all, judges among them, would come after the run."""
    later = [(rounds - 1) * sigma] if rounds > 1 else []
    return {
        'rounds': rounds,
        'sigma': sigma,
        'periods': [sigma, *later],
        'restart_weights': [1, *([0.8] if later else [])],
        'label_refreshes': rounds + 1,
        'val_rounds': rounds,
        'checkpoint_interval': max(1, min(sigma, round(CHECKPOINT_SECONDS / max(epoch_seconds, 1e-3)))),
    }


def _inputs(files: LabelledFiles, folder: Path, place: bool) -> dict[str, Any]:
    """Write clicks and the list of scans, and return the keys that name them and what the scans hold."""
    given, clicks, named = files.given, folder / 'clicks.json', files.options.columns
    write_clicks(clicks, clicks_of(given), given.names)
    write_text(folder / 'scans.txt', ''.join(f'{scan.resolve()}\n' for scan in files.scans))
    shared = shared_channels([sensed(scan.stem, files.prepared(scan).scene.cloud) for scan in files.scans])
    return {
        'data_root': str(folder.resolve()),
        'scan_list': 'scans.txt',
        'budget': {'clicks': str(clicks.resolve())},
        'cache_dir': str(folder / 'cache'),
        'class_names': list(given.names),
        'num_classes': len(given.names),
        'columns': named or {'label': None},
        'other_labels': 'ignore',
        'use_columns': [*shared, *(OWN if place else OWN[:1])],
        'log_level': 'ERROR',
    }


def clicks_of(given: GivenLabels) -> list[Click]:
    """Labels as clicks by number."""
    return [
        Click(name, int(semantic), index=int(point))
        for name, labels in given.scans.items()
        for point, semantic in zip(labels.points, labels.semantic, strict=True)
    ]
