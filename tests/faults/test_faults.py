"""Whatever happens to a run, it ends as an undisturbed one, bit for bit, or is told in one message.

``make faults`` kills 25 runs and fills 10 disks (RM3D_FAULTS = how many kills).
"""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from runs import tiny_runs, toy_runs
from runs.same_run import assert_same_run

KILLS = int(os.environ.get('RM3D_FAULTS', '1'))
DISKS = 10 * (KILLS > 1)


def segment(folder: Path, log: Path, resume: bool = False) -> tiny_runs.Started:
    return tiny_runs.begin(log, partial(toy_runs.train, folder, resume=resume))


class Detection:
    """Runs of the command ``train`` on three streets."""

    def __init__(self, world: Path, base: Path) -> None:
        self.world, self.base = world, base
        self.count = 0

    def __call__(self, folder: Path, *words: str, cache: Path | None = None) -> tiny_runs.Started:
        settings = tiny_runs.options(self.world, **({} if cache is None else {'cache_dir': str(cache)}))
        self.count += 1
        cwd = self.base / f'cwd{self.count}'
        cwd.mkdir()
        arguments = [*tiny_runs.arguments_of(settings, folder), *words]
        return tiny_runs.begin(self.base / f'log{self.count}.txt', tiny_runs.command, 'train', cwd, arguments)


@pytest.fixture(scope='module')
def train(world, tmp_path_factory) -> Detection:
    return Detection(world, tmp_path_factory.mktemp('faults'))


class Unbroken:
    """An undisturbed run, and how long such a run takes."""

    def __init__(self, folder: Path, started: tiny_runs.Started) -> None:
        began = time.perf_counter()
        code, log = started.end()
        assert code == 0, log
        self.folder, self.seconds = folder, time.perf_counter() - began


@pytest.fixture(scope='module')
def detection(train, tmp_path_factory) -> Unbroken:
    folder = tmp_path_factory.mktemp('detection') / 'run'
    train(folder.parent / 'first').end()  # kernels are compiled, geometry lies in the cache
    return Unbroken(folder, train(folder))


@pytest.fixture(scope='module')
def segmentation(tmp_path_factory) -> Unbroken:
    folder = tmp_path_factory.mktemp('segmentation') / 'run'
    segment(folder.parent / 'first', folder.parent / 'first.txt').end()
    return Unbroken(folder, segment(folder, folder.parent / 'log.txt'))


def told(result: tuple[int, str]) -> str:
    """The one message of a command that was refused or could not go on."""
    code, log = result
    assert code == 2 and 'Traceback' not in log, log
    (message,) = [line for line in log.splitlines() if line.startswith('error:')]
    return message


@pytest.mark.parametrize('number', [n for n in range(KILLS) if n % 2 == 0])
def test_a_killed_segmentation_goes_on_bit_for_bit(segmentation, tmp_path, number):
    moment = np.random.default_rng([1, number]).uniform(0.1, 1.0) * segmentation.seconds
    code, log = segment(tmp_path / 'run', tmp_path / 'killed.txt').end(moment)
    assert code in (-signal.SIGKILL, 0), log
    code, log = segment(tmp_path / 'run', tmp_path / 'resumed.txt', resume=True).end()
    assert code == 0, (moment, log)
    assert_same_run(tmp_path / 'run', segmentation.folder, epoch=4)


@pytest.mark.parametrize('number', [n for n in range(KILLS) if n % 2 == 1])
def test_a_killed_detection_goes_on_bit_for_bit(detection, train, tmp_path, number):
    """Every second one begins without geometry, so that it may die while it writes the cache."""
    rng = np.random.default_rng([2, number])
    cache = tmp_path / 'geometry' if number % 4 == 3 else None
    code, log = train(tmp_path / 'run', cache=cache).end(rng.uniform(0.1, 1.0) * detection.seconds)
    assert code in (-signal.SIGKILL, 0), log
    code, log = train(tmp_path / 'run', '--resume', cache=cache).end()
    assert code == 0, log
    assert_same_run(tmp_path / 'run', detection.folder)


def test_killed_twice(detection, train, tmp_path):
    if KILLS < 2:
        pytest.skip('make faults')
    for share, words in ((0.6, ()), (0.7, ('--resume',))):
        code, log = train(tmp_path / 'run', *words).end(share * detection.seconds)
        assert code in (-signal.SIGKILL, 0), log
    code, log = train(tmp_path / 'run', '--resume').end()
    assert code == 0, log
    assert_same_run(tmp_path / 'run', detection.folder)


@contextmanager
def disk(place: Path, kilobytes: int) -> Iterator[Path]:
    """A small disk of its own; tests are skipped where nobody may mount one."""
    place.mkdir()
    mounted = subprocess.run(['mount', '-t', 'tmpfs', '-o', f'size={kilobytes}k', 'tmpfs', place], capture_output=True)
    if mounted.returncode:
        pytest.skip('a disk of its own: only root may mount one')
    try:
        yield place
    finally:
        subprocess.run(['umount', '-l', place], check=True)


def remount(place: Path, option: str) -> None:
    subprocess.run(['mount', '-o', f'remount,{option}', place], check=True)


def used_kilobytes(folder: Path) -> int:
    return sum(-(-path.stat().st_size // 4096) * 4 for path in folder.rglob('*') if path.is_file())


@pytest.mark.parametrize('number', range(DISKS))
def test_a_full_disk_is_told_and_the_run_goes_on_when_there_is_room(detection, train, tmp_path, number):
    whole = used_kilobytes(detection.folder)
    size = int(np.random.default_rng([3, number]).uniform(0.02, 0.9) * whole)
    with disk(tmp_path / 'disk', max(size, 16)) as place:
        message = told(train(place / 'run').end())
        assert 'No space left on device' in message and str(place) in message, message
        assert not list(place.rglob('.*.tmp')), 'parts of files were left behind'
        remount(place, f'size={10 * whole}k')
        code, log = train(place / 'run', '--resume').end()
        assert code == 0, log
        assert_same_run(place / 'run', detection.folder)


def test_read_only_folders_are_told(detection, train, tmp_path):
    if KILLS < 2:
        pytest.skip('make faults')
    with disk(tmp_path / 'disk', 20000) as place:
        shutil.copytree(train.world.parent / 'geometry', place / 'geometry')
        remount(place, 'ro')
        assert f'{place / "run"}' in told(train(place / 'run').end())
        assert f'{place} is read-only; name another folder' in told(
            train(tmp_path / 'made', cache=place / 'other').end()
        )
        code, log = train(tmp_path / 'run', cache=place / 'geometry').end()  # what lies there is enough
        assert code == 0, log
        assert_same_run(tmp_path / 'run', detection.folder)


def test_two_runs_share_a_cache(detection, train, tmp_path):
    if KILLS < 2:
        pytest.skip('make faults')
    both = [train(tmp_path / name, cache=tmp_path / 'geometry') for name in ('a', 'b')]
    for name, (code, log) in zip('ab', [started.end() for started in both], strict=True):
        assert code == 0, log
        assert_same_run(tmp_path / name, detection.folder)


def test_of_two_runs_in_a_work_dir_one_is_refused(detection, train, tmp_path):
    if KILLS < 2:
        pytest.skip('make faults')
    results = [started.end() for started in [train(tmp_path / 'run') for _ in range(2)]]
    (winner,) = [result for result in results if result[0] == 0] or [results]
    (loser,) = [result for result in results if result is not winner]
    assert 'works there' in told(loser) or 'holds' in told(loser)
    assert_same_run(tmp_path / 'run', detection.folder)
