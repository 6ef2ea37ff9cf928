"""Shared fixtures; shape annotations are checked at run time in the packages that hold no numba kernels."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('MPLBACKEND', 'Agg')

from jaxtyping import install_import_hook

install_import_hook(['rm3d_plugin.structures', 'rm3d_plugin.models'], 'beartype.beartype')

import pytest  # noqa: E402  the hook must stand before what it checks
import torch  # noqa: E402
from runs import tiny_runs  # noqa: E402

torch.set_num_threads(1)


@pytest.fixture(scope='session')
def real_data() -> Path:
    """Folder of small real scans; the tests that need it are skipped where it is absent."""
    default = Path(__file__).resolve().parents[2] / 'shared' / 'data'
    folder = Path(os.environ.get('RM3D_REAL_DATA', default))
    if not folder.is_dir():
        pytest.skip(f'real data not found at {folder}; set RM3D_REAL_DATA')
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
