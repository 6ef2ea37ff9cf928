"""Shared fixtures; shape annotations are checked at run time in the packages that hold no numba kernels."""

import os
from pathlib import Path

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('MPLBACKEND', 'Agg')

from jaxtyping import install_import_hook

install_import_hook(['rm3d_plugin.structures', 'rm3d_plugin.models'], 'beartype.beartype')

import pytest  # noqa: E402  the hook must stand before what it checks
import torch  # noqa: E402

torch.set_num_threads(1)


@pytest.fixture(scope='session')
def real_data() -> Path:
    """Folder of small real scans; the tests that need it are skipped where it is absent."""
    default = Path(__file__).resolve().parents[2] / 'shared' / 'data'
    folder = Path(os.environ.get('RM3D_REAL_DATA', default))
    if not folder.is_dir():
        pytest.skip(f'real data not found at {folder}; set RM3D_REAL_DATA')
    return folder
