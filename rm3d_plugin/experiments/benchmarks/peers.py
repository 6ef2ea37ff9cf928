"""Programs that our geometry is compared with; one that the machine lacks is named, not needed."""

import glob
import importlib
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.experiments.benchmarks.measure import Seconds

SOURCE = Path(__file__).with_name('pcl_peer.cpp')
PARTS = ('common', 'octree', 'search', 'kdtree', 'features', 'segmentation')
ABSENT = 'not available'


class Answer(NamedTuple):
    """What the C++ program did.

    Attributes:
        seconds: Processor time of the job alone, reading and writing files left out (one thread, so wall time too).
        values: What it wrote, flat.
    """

    seconds: Seconds
    values: np.ndarray


def optional(name: str) -> ModuleType | None:
    """An installed package, or None where it cannot be imported (Open3D needs libusb and libGL, say)."""
    try:
        return importlib.import_module(name)
    except (ImportError, OSError):
        return None


@cache
def pcl_program() -> Path | None:
    """The compiled peer, or None without g++ and the headers and libraries of PCL (below ``PCL_ROOT``, else /usr)."""
    root = os.environ.get('PCL_ROOT', '/usr')
    headers = sorted(glob.glob(f'{root}/include/pcl-*'))
    libraries = [sorted(glob.glob(f'/usr/lib/*/libpcl_{part}.so*')) for part in PARTS]
    if shutil.which('g++') is None or not headers or not all(libraries):
        return None
    program = Path(tempfile.gettempdir()) / f'rm3d_pcl_peer_{SOURCE.stat().st_mtime_ns}'
    if not program.exists():
        # Not -march=native: PCL's own libraries are built for any processor, and wider vectors would not fit them.
        flags = ['-O3', '-std=c++17', '-w', f'-I{headers[-1]}', '-I/usr/include/eigen3']
        linked = [found[0] for found in libraries]
        subprocess.run(['g++', *flags, str(SOURCE), '-o', str(program), *linked], check=True)
    return program


class PclPeer:
    """The C++ program on one cloud.

    Args:
        xyz: (N, 3) float32 metres.
        normals: (N, 3) float32, or None.
        folder: Where the arrays are handed over.
    """

    def __init__(
        self, xyz: Float[np.ndarray, 'points 3'], normals: Float[np.ndarray, 'points 3'] | None, folder: Path
    ) -> None:
        self._count, self._folder = len(xyz), folder
        xyz.astype(np.float32).tofile(folder / 'points')
        self._normals = '-'
        if normals is not None:
            self._normals = str(folder / 'normals')
            normals.astype(np.float32).tofile(self._normals)

    def run(self, job: str, radius: float = 0.0, k: int = 0, dtype: type = np.int32) -> Answer:
        """Run a job and read what it wrote."""
        program = pcl_program()
        if program is None:
            raise FileNotFoundError('PclPeer: no g++ or no headers of PCL; ask pcl_program() first')
        out = self._folder / 'out'
        given = [job, self._folder / 'points', self._normals, self._count, repr(radius), k, out]
        environment = {**os.environ, 'OMP_NUM_THREADS': '1'}
        done = subprocess.run([program, *map(str, given)], check=True, capture_output=True, text=True, env=environment)
        spent = float(done.stdout.split()[-1])
        return Answer(Seconds(spent, spent), np.fromfile(out, dtype=dtype))
