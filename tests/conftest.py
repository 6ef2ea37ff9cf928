"""Shared fixtures; shape annotations are checked at run time in every module that holds no numba kernels."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('MPLBACKEND', 'Agg')

import shape_checks

shape_checks.install()

import pytest  # noqa: E402  the hook must stand before what it checks
import torch  # noqa: E402
from runs import tiny_runs  # noqa: E402

torch.set_num_threads(1)


def find_real_data() -> Path | None:
    """The folder that ``RM3D_REAL_DATA`` names, else ``shared/data`` beside the checkout or in it; None without any."""
    named = os.environ.get('RM3D_REAL_DATA')
    checkout = Path(__file__).resolve().parents[1]
    places = [Path(named)] if named else [checkout.parent / 'shared' / 'data', checkout / 'shared' / 'data']
    return next((place for place in places if place.is_dir()), None)


def pytest_report_header() -> str:
    folder = find_real_data()
    return f'real scans: {folder or "none (RM3D_REAL_DATA names no folder); their tests are skipped"}'


SHARED_RUNS = ('finished', 'trained')  # made once in a session: the files that read one belong to one process


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A file, or the files that read one run, is what a process of pytest-xdist takes; those with slow tests first."""
    groups, slow = {}, set()
    for item in items:
        defined = item._fixtureinfo.name2fixturedefs if isinstance(item, pytest.Function) else {}
        for name in SHARED_RUNS:
            if name in defined and defined[name][0].scope == 'session':
                groups[item.path] = name
        if item.get_closest_marker('slow'):
            slow.add(item.path)
    for item in items:
        item.add_marker(pytest.mark.xdist_group(groups.get(item.path, str(item.path))))
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope='session')
def real_data() -> Path:
    """Folder of small real scans; the tests that need it are skipped where it is absent."""
    folder = find_real_data()
    if folder is None:
        pytest.skip('no real scans: RM3D_REAL_DATA names no folder, and ../shared/data is not there')
    return folder


@dataclass(frozen=True)
class FinishedRun:
    """An undisturbed training."""

    folder: Path
    log: str

    @property
    def record(self) -> dict[str, Any]:
        return json.loads((self.folder / 'metrics.json').read_text())


@pytest.fixture(scope='session')
def world(tmp_path_factory) -> Path:
    return tiny_runs.make_world(tmp_path_factory.mktemp('streets') / 'kitti')


@pytest.fixture(scope='session')
def finished(world, tmp_path_factory) -> FinishedRun:
    base = tmp_path_factory.mktemp('finished')
    code, log = tiny_runs.run(
        base / 'log.txt', tiny_runs.train, base / 'run', tiny_runs.options(world), False, None, True
    )
    assert code == 0, log
    return FinishedRun(base / 'run', log)
