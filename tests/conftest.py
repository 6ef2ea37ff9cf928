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
