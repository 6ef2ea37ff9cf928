"""What every benchmark needs: interleaved medians, the rate of matrix products, the facts of the machine."""

import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numba
import torch


class Seconds(NamedTuple):
    """Median seconds of a job.

    Attributes:
        wall: On the clock; other load on the machine counts.
        cpu: Of processor time, summed over threads: what the job itself costs.
    """

    wall: float
    cpu: float


def interleaved_medians(
    jobs: Mapping[str, Callable[[], object]], repeats: int, warm: bool = True
) -> dict[str, Seconds]:
    """Median seconds of each job; the jobs take turns, so that other load on the machine meets all of them.

    Args:
        jobs: What to time; one that returns ``Seconds`` (another program's own measure) is taken at its word.
        repeats: Timed rounds.
        warm: Run each job once before, untimed: compiles, fills caches.
    """
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in jobs}
    if warm:
        for job in jobs.values():
            job()
    for _ in range(repeats):
        for name, job in jobs.items():
            wall, cpu = time.perf_counter(), time.process_time()
            told = job()
            spent = Seconds(time.perf_counter() - wall, time.process_time() - cpu)
            times[name].append(told if isinstance(told, Seconds) else spent)
    return {name: Seconds(*map(statistics.median, zip(*values, strict=True))) for name, values in times.items()}


def table(seconds: Mapping[str, Seconds], ours: str) -> dict[str, dict[str, float]]:
    """Seconds of each job, and how many times as long as ours it takes in processor time."""
    return {
        name: {
            'wall_s': round(found.wall, 4),
            'cpu_s': round(found.cpu, 4),
            'times_ours': round(found.cpu / seconds[ours].cpu, 2),
        }
        for name, found in seconds.items()
    }


def matrix_product(side: int = 768) -> tuple[Callable[[], object], float]:
    """A square float32 product and its floating-point operations: the rate that the machine can reach."""
    left, right = torch.rand(side, side), torch.rand(side, side)
    return lambda: left @ right, 2.0 * side**3


def in_own_process(module: str, function: str, threads: int, arguments: Sequence[object]) -> dict[str, Any]:
    """What a function says in a fresh process, whose peak of memory is its own; see :func:`in_own_processes`."""
    return in_own_processes(module, function, threads, arguments, 1)[0]


def in_own_processes(
    module: str, function: str, threads: int, arguments: Sequence[object], processes: int
) -> list[dict[str, Any]]:
    """What a function says in each of several fresh processes that run at the same time.

    Args:
        module: Where it is.
        function: Takes the arguments, gives what JSON holds.
        threads: Of torch and of our kernels.
        arguments: What JSON holds.
        processes: How many.

    Raises:
        subprocess.CalledProcessError: One of them failed.
    """
    text = f'import json, sys, torch; from {module} import {function}; torch.set_num_threads({threads}); '
    text += f'print(json.dumps({function}(*json.loads(sys.argv[1]))))'
    environment = {**os.environ, 'NUMBA_NUM_THREADS': str(threads), 'PYTHONPATH': os.pathsep.join(sys.path)}
    command = [sys.executable, '-c', text, json.dumps(list(arguments))]
    children = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(processes)]
    texts = [child.communicate()[0] for child in children]
    for child in children:
        if child.returncode:
            raise subprocess.CalledProcessError(child.returncode, command)
    return [json.loads(said.splitlines()[-1]) for said in texts]


def forget_peak() -> None:
    """Start the peak of this process's memory anew, where the system can (Linux)."""
    place = Path('/proc/self/clear_refs')
    if place.exists():
        place.write_text('5')


def memory_mb(name: str) -> int | None:
    """A figure of this process's memory (``VmHWM``: the peak) in MiB, or None where the system does not tell."""
    status = Path('/proc/self/status')
    lines = status.read_text().splitlines() if status.exists() else []
    return next((round(int(line.split()[1]) / 1024) for line in lines if line.startswith(f'{name}:')), None)


def machine() -> dict[str, Any]:
    """Processor, cores, threads in use, load and versions."""
    model = platform.processor()
    if os.path.exists('/proc/cpuinfo'):
        with open('/proc/cpuinfo') as lines:
            model = next((line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')), model)
    return {
        'processor': model,
        'cores': os.cpu_count(),
        'gpu': torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        'load_average': round(os.getloadavg()[0], 2),
        'torch': torch.__version__,
        'torch_threads': torch.get_num_threads(),
        'numba': numba.__version__,
        'numba_threads': int(numba.config.NUMBA_NUM_THREADS),
        'python': platform.python_version(),
    }
