"""What a run costs: seconds and bytes of its phases by points, fitted to measurements, and told for large data sets."""

import argparse
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls

from rm3d_plugin.experiments.benchmarks import large_scene
from rm3d_plugin.experiments.benchmarks.measure import in_own_processes, machine

NAME = 'cost-model'
HELP = 'fit seconds and bytes of the phases of a run to several sizes, check them on another, tell what large data cost'
PHASES = ('labels, round 0', 'step', 'labels, round 1', 'prediction')
TERMS: dict[str, Callable[[float], float]] = {
    'constant': lambda points: 1.0,
    'points': lambda points: points,
    'points log2 points': lambda points: points * math.log2(points),
}
GROWTH = {'cpu_s': tuple(TERMS), 'peak_mb': ('constant', 'points')}


class Workload(NamedTuple):
    """A data set and a schedule.

    Attributes:
        scenes: That are learnt from.
        points: Of a scene, or of a tile of a scene.
        epochs: Over all scenes.
        refreshes: How often labels are made, the first time included.
    """

    scenes: int
    points: int
    epochs: int
    refreshes: int


# Training scans: ScanNet v2's list; SemanticKITTI's sequences 00 to 10 without 08. Points of a scan are round figures,
# to be replaced by those of one's own data; a city: tiles of a million points.
# Epochs: METHOD 7, a tenth of it outdoors.
WORKLOADS = {
    'ScanNet': Workload(1201, 150_000, 520, 8),
    'SemanticKITTI': Workload(19_130, 120_000, 52, 8),
    'city of 1e10 points': Workload(10_000, 1_000_000, 52, 8),
}
CORES = (2, 64, 1024)  # in all: processes and threads together


@dataclass(frozen=True)
class CostModel:
    """Seconds of processor time and MiB of each phase as sums of growing terms.

    Attributes:
        weights: (phase, 'cpu_s' or 'peak_mb') -> weight of each term of :data:`GROWTH`, none negative.
        crop: Most points of a training step.
        beside: Times as many processor seconds where other processes run beside.
    """

    weights: Mapping[tuple[str, str], tuple[float, ...]]
    crop: int
    beside: float = 1.0

    def cost(self, phase: str, what: str, points: float) -> float:
        """Seconds or MiB of a phase of one scene.

        Args:
            phase: One of :data:`PHASES`.
            what: 'cpu_s' or 'peak_mb'.
            points: Of the scene; a step sees no more than the crop.
        """
        seen = min(points, self.crop) if phase == 'step' else points
        terms = (TERMS[name](seen) for name in GROWTH[what])
        return sum(weight * term for weight, term in zip(self.weights[phase, what], terms, strict=True))

    def cpu_seconds(self, work: Workload) -> dict[str, float]:
        """Processor seconds of each phase of a whole run, in processes beside each other."""
        once = {phase: self.beside * self.cost(phase, 'cpu_s', work.points) * work.scenes for phase in PHASES}
        return {
            'first labels': once['labels, round 0'],
            'training': once['step'] * work.epochs,
            'further labels': once['labels, round 1'] * (work.refreshes - 1),
            'prediction': once['prediction'],
        }

    def peak_mib(self, work: Workload) -> float:
        """Memory of a process: of its largest phase, one scene at a time."""
        return max(self.cost(phase, 'peak_mb', work.points) for phase in PHASES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument(
        '--sizes',
        type=int,
        nargs='+',
        default=[10_000, 30_000, 100_000, 300_000, 1_000_000, 3_000_000],
        help='points of a scan',
    )
    parser.add_argument('--processes', type=int, default=2, help='that run beside each other')
    parser.add_argument(
        '--together', type=int, default=100_000, help='points of the scans that they run on; of --sizes'
    )
    parser.add_argument('--unseen', type=int, default=200_000, help='points of the scan that the fit has not seen')
    parser.add_argument('--crop', type=int, default=100_000, help='most points of a step')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Measure each size in a process of its own, fit, check, and tell what large data cost."""
    measured = {size: _measure(size, args) for size in {*args.sizes, args.together, args.unseen}}
    together = {size: _measure(size, args, args.processes) for size in (args.together, args.unseen)}
    beside = cpu_seconds(together[args.together]) / cpu_seconds(measured[args.together])
    model = replace(fit({size: measured[size] for size in args.sizes}, args.crop), beside=beside)
    return {
        'crop': args.crop,
        'measured': measured,
        'weights': {f'{phase}, {what}': weights for (phase, what), weights in model.weights.items()},
        'terms': {what: list(names) for what, names in GROWTH.items()},
        'processes': {'at a time': args.processes, 'times the seconds': round(beside, 3), 'measured': together},
        'unseen': check(model, args.unseen, measured[args.unseen]),
        'unseen, processes': check(model, args.unseen, together[args.unseen], beside),
        'projections': {name: project(model, work) for name, work in WORKLOADS.items()},
        'machine': machine(),
    }


def cpu_seconds(found: Mapping[str, Mapping[str, float]]) -> float:
    """Of all phases."""
    return sum(phase['cpu_s'] for phase in found.values())


def fit(measured: Mapping[int, Mapping[str, Mapping[str, float]]], crop: int) -> CostModel:
    """Non-negative least squares of relative errors, each phase and quantity by itself.

    Args:
        measured: Points -> phase -> 'cpu_s' and 'peak_mb'.
        crop: Most points of a step.

    Raises:
        ValueError: Fewer than two sizes: nothing grows.
    """
    if len(measured) < 2:
        raise ValueError(f'fit: expected two sizes or more, got {list(measured)}')
    return CostModel(
        {(phase, what): _weights(measured, phase, what, crop) for phase in PHASES for what in GROWTH}, crop
    )


def check(
    model: CostModel, points: int, found: Mapping[str, Mapping[str, float]], beside: float = 1.0
) -> dict[str, dict[str, float]]:
    """What the model said of a size that it has not seen, and by how many percent it is off.

    Args:
        model: Fitted.
        points: The size.
        found: Phase -> 'cpu_s' and 'peak_mb', measured.
        beside: Times as many seconds as of one process.
    """
    factors = {'cpu_s': beside, 'peak_mb': 1.0}
    said = {(phase, what): factors[what] * model.cost(phase, what, points) for phase in PHASES for what in GROWTH}
    told = {f'{phase}, {what}': _told(value, found[phase][what]) for (phase, what), value in said.items()}
    whole = sum(value for (_, what), value in said.items() if what == 'cpu_s')
    return {**told, 'all phases, cpu_s': _told(whole, cpu_seconds(found))}


def project(model: CostModel, work: Workload) -> dict[str, Any]:
    """Core hours of a run, hours on so many cores (scenes divide evenly, nothing else is counted), MiB of a process."""
    seconds = model.cpu_seconds(work)
    hours = sum(seconds.values()) / 3600
    return {
        'core_hours': {name: round(value / 3600, 1) for name, value in seconds.items()},
        'hours': {f'{cores} cores': round(hours / min(cores, work.scenes), 1) for cores in CORES},
        'process_mib': round(model.peak_mib(work)),
    }


def phases_of(found: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Phases of the large-scene benchmark by the names here; a step is the second, as the first compiles."""
    steps = [name for name in found if name.startswith('step ')]
    names = {phase: phase if phase in found else steps[1] for phase in PHASES}
    return {phase: {what: float(found[name][what]) for what in GROWTH} for phase, name in names.items()}


def _measure(points: int, args: argparse.Namespace, processes: int = 1) -> dict[str, dict[str, float]]:
    """Phases of a run on a scan; of several processes at the same time the mean."""
    asked = [points, args.crop, 2, args.threads]
    answers = in_own_processes(large_scene.__name__, 'one', args.threads, asked, processes)
    found = mean_phases([phases_of(answer['phases']) for answer in answers])
    print(f'{points} points, {processes} at a time: {cpu_seconds(found):.0f} CPU s', file=sys.stderr, flush=True)
    return found


def mean_phases(found: Sequence[Mapping[str, Mapping[str, float]]]) -> dict[str, dict[str, float]]:
    """The mean of several measurements of the same phases."""
    return {phase: {what: sum(own[phase][what] for own in found) / len(found) for what in GROWTH} for phase in PHASES}


def _weights(
    measured: Mapping[int, Mapping[str, Mapping[str, float]]], phase: str, what: str, crop: int
) -> tuple[float, ...]:
    sizes = [min(size, crop) if phase == 'step' else size for size in measured]
    values = np.maximum([found[phase][what] for found in measured.values()], 1e-3)
    rows = np.array([[TERMS[name](size) for name in GROWTH[what]] for size in sizes]) / values[:, None]
    scale = rows.max(axis=0)
    return tuple((nnls(rows / scale, np.ones(len(rows)))[0] / scale).tolist())


def _told(said: float, true: float) -> dict[str, float]:
    off = round(100 * (said / true - 1), 1) if true else math.inf
    return {'said': round(said, 2), 'measured': round(true, 2), 'off_percent': off}
