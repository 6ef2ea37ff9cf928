"""Peak memory and CPU time of thinning a Semantic3D station.

``python -m rm3d_plugin.experiments.benchmarks.semantic3d_memory [MILLIONS]``; its file is made and removed again.
"""

import multiprocessing
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from rm3d_plugin.datasets.semantic3d import Semantic3DDataset

LINES = 500_000  # of the block that the file repeats, each time 40 m further


def write_station(folder: Path, millions: float) -> int:
    """A street of repeated blocks of 40 m x 40 m; returns the number of lines."""
    rng = np.random.default_rng(0)
    blocks = max(1, round(millions * 1e6 / LINES))
    xyz = rng.uniform(0, 40, (LINES, 3)) * [1, 1, 0.05]
    rest = np.column_stack([rng.integers(-2048, 2048, LINES), rng.integers(0, 256, (LINES, 3))])
    labels = ''.join(f'{label}\n' for label in rng.integers(0, 9, LINES).tolist())
    with (folder / 'sg27_station4_intensity_rgb.txt').open('w') as points:
        for block in range(blocks):
            shifted = xyz + [40.0 * block, 0, 0]
            for (x, y, z), (i, r, g, b) in zip(shifted.tolist(), rest.tolist(), strict=True):
                points.write(f'{x:.3f} {y:.3f} {z:.3f} {i} {r} {g} {b}\n')
    (folder / 'sg27_station4_intensity_rgb.labels').write_text(labels * blocks)
    return blocks * LINES


def peak() -> float:
    """Greatest resident memory of this process so far, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Measure and print."""
    millions = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with multiprocessing.get_context('spawn').Pool(1) as pool:  # its memory is not the reader's
            lines = pool.apply(write_station, (folder, millions))
        size = (folder / 'sg27_station4_intensity_rgb.txt').stat().st_size / 2**20
        dataset = Semantic3DDataset(folder, stations=['sg27_station4'], voxel_downsample=0.2, cache=folder / 'cache')
        before, start = peak(), time.process_time()
        kept = len(dataset.load_cloud(0))
        first, middle = time.process_time() - start, time.process_time()
        after = peak()
        dataset = Semantic3DDataset(folder, stations=['sg27_station4'], voxel_downsample=0.2, cache=folder / 'cache')
        assert len(dataset.load_cloud(0)) == kept
        again = time.process_time() - middle
        assert sum(map(len, dataset.original_pieces(0))) == lines
    print(f'{lines} lines, {size:.0f} MiB of text, {kept} points kept at 0.2 m')
    print(f'first reading {first:.1f} s CPU, from the cache {again:.2f} s')
    print(f'peak memory {before:.0f} MiB before, {after:.0f} MiB after: {after - before:.0f} MiB for the scene')


if __name__ == '__main__':
    main()
