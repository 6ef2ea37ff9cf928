"""A short training on one large scan without colour, far from the origin: each phase's processor time and memory."""

import argparse
import csv
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from mmengine.hooks import Hook
from mmengine.runner import Runner

from rm3d_plugin.engine.hooks.run_record_hook import read_record
from rm3d_plugin.engine.round_times import Stopwatch
from rm3d_plugin.experiments.benchmarks.measure import forget_peak, in_own_process, machine, memory_mb
from rm3d_plugin.registry import HOOKS
from rm3d_plugin.storage import LabelStore, read_json, write_json
from rm3d_plugin.storage.ply import write_ply

NAME = 'large-scene'
HELP = 'labels of round 0, steps of a crop, a refresh and a prediction of one scan in UTM coordinates without colour'
CONFIG = 'rm3d_plugin::rm3d_sem_files_streets_clicks.py'
UTM = (448_263.4, 5_411_932.7, 312.9)  # m
CLASSES = ('ground', 'wall', 'roof')
BLOCK, HOUSE, HEIGHT = 20.0, 8.0, 6.0  # m: of ground, of the house in its middle
DENSITY = 200  # points a square metre; fewer than 120,000 points are one block, thinner
CLICKS = 20  # of each class


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument('--points', type=int, default=3_000_000, help='of the scan')
    parser.add_argument('--crop', type=int, default=300_000, help='most points of a step, and of a predicted chunk')
    parser.add_argument('--steps', type=int, default=3, help='training steps before and after the refresh')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Train in a process of its own."""
    answer = in_own_process(__name__, 'one', args.threads, [args.points, args.crop, args.steps, args.threads])
    return {**answer, 'threads': args.threads, 'machine': machine()}


def make_scan(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Houses on a flat ground, (N, 3) float64 UTM metres, and the class of each point."""
    rng = np.random.default_rng(0)
    areas = np.array([BLOCK**2 - HOUSE**2, 4 * HOUSE * HEIGHT, HOUSE**2])
    side = max(1, round((points / DENSITY / areas.sum()) ** 0.5))
    label = rng.choice(3, points, p=areas / areas.sum())
    square = rng.uniform(0, HOUSE, (points, 2))
    wall = label == 1
    square[wall, 0] = np.where(rng.random(wall.sum()) < 0.5, 0.0, HOUSE)
    square[wall] = np.where(rng.random((wall.sum(), 1)) < 0.5, square[wall], square[wall][:, ::-1])
    square += (BLOCK - HOUSE) / 2
    outside = rng.uniform(0, BLOCK, (2 * points, 2))
    outside = outside[np.abs(outside - BLOCK / 2).max(axis=1) > HOUSE / 2]
    square[label == 0] = outside[: (label == 0).sum()]
    height = np.choose(label, [np.zeros(points), rng.uniform(0, HEIGHT, points), np.full(points, HEIGHT)])
    xyz = np.column_stack([square + BLOCK * rng.integers(0, side, (points, 2)), height])
    return xyz + rng.normal(0, 0.01, xyz.shape) + UTM, label


def write_scan(folder: Path, points: int) -> None:
    """The scan with its labels, which the run is judged by, and some clicks, which it learns from."""
    xyz, label = make_scan(points)
    rng = np.random.default_rng(1)
    (folder / 'scans').mkdir()
    write_ply(
        folder / 'scans' / 'town.ply',
        {**{axis: xyz[:, i] for i, axis in enumerate('xyz')}, 'label': label.astype(np.int32)},
    )
    rows = [
        ('town', row, name)
        for number, name in enumerate(CLASSES)
        for row in rng.choice(np.flatnonzero(label == number), CLICKS, replace=False)
    ]
    with (folder / 'clicks.csv').open('w', newline='') as file:
        csv.writer(file).writerows([('scene', 'index', 'class'), *rows])


def options(folder: Path, crop: int, steps: int, threads: int) -> dict[str, Any]:
    """What the config of one's own scans is told."""
    return {
        'data_root': str(folder / 'scans'),
        'cache_dir': str(folder / 'geometry'),
        'budget.clicks': str(folder / 'clicks.csv'),
        'class_names': list(CLASSES),
        'num_classes': len(CLASSES),
        'val_labels': 'truth',
        'crop_points': crop,
        'model.inference.max_points': crop,
        'rounds': 2,
        'sigma': steps,
        'periods': [steps, steps],
        'restart_weights': [1, 1],
        'val_rounds': 2,
        'threads': threads,
    }


@HOOKS.register_module()
class PhaseHook(Hook):
    """Writes what each phase of a run took to ``phases.json``; behind every hook that does the work.

    Args:
        refresh: Epochs, each of one step, before the labels are made anew.
    """

    priority = 'LOWEST'

    def __init__(self, refresh: int) -> None:
        self.refresh = refresh
        self.phases: dict[str, dict[str, float | None]] = {}
        self._begin()

    def before_train(self, runner: Runner) -> None:
        """The labels of round 0 are there."""
        self._end(runner, 'labels, round 0')

    def before_train_epoch(self, runner: Runner) -> None:
        """The labels may be new."""
        if runner.epoch == self.refresh:
            self._end(runner, 'labels, round 1')

    def after_train_epoch(self, runner: Runner) -> None:
        """An epoch is one step."""
        self._end(runner, f'step {runner.epoch + 1}')

    def after_val_epoch(self, runner: Runner, metrics: dict[str, float] | None = None) -> None:
        """The scan was predicted."""
        self._end(runner, 'prediction')

    def _begin(self) -> None:
        forget_peak()
        self._watch = Stopwatch()

    def _end(self, runner: Runner, name: str) -> None:
        self.phases[name] = {'cpu_s': round(self._watch.read().cpu, 2), 'peak_mb': memory_mb('VmHWM')}
        write_json(Path(runner.work_dir) / 'phases.json', self.phases)
        self._begin()


def one(points: int, crop: int, steps: int, threads: int) -> dict[str, Any]:
    """Make the scan and train on it in this process."""
    from mmengine.registry import init_default_scope

    from rm3d_plugin.engine.config import load_config
    from rm3d_plugin.engine.run import set_threads, train
    from rm3d_plugin.registry import SCOPE

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_scan(folder, points)
        config = load_config(CONFIG, folder / 'run', options=options(folder, crop, steps, threads))
        config.custom_hooks = [*config.custom_hooks, {'type': 'PhaseHook', 'refresh': steps}]
        set_threads(threads)
        init_default_scope(SCOPE)
        before = memory_mb('VmRSS')
        work_dir = train(config)
        store = LabelStore(work_dir / 'labels')
        return {
            'points': points,
            'crop': crop,
            'before_mb': before,
            'phases': read_json(work_dir / 'phases.json'),
            'labels': [
                {name: store.summary(number)[name] for name in ('coverage', 'precision')} for number in store.rounds()
            ],
            'scores': read_record(work_dir)['final'],
        }
