"""Damaged files of every kind: a scan, or a message that names the file; no other error, no waiting.

``make fuzz`` tries many more (RM3D_FUZZ = cases of each kind).
"""

import os
import time
import warnings

import numpy as np
import pytest
from storage.damage import damaged

from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.structures import SceneError

CASES = int(os.environ.get('RM3D_FUZZ', '40'))
RNG = np.random.default_rng(0)
XYZ = RNG.random((30, 3)) * 9


def written(folder, kind):
    """The bytes of a good file."""
    path = folder / f'good{kind}'
    rows = '\n'.join(' '.join(f'{value:.3f}' for value in row) for row in XYZ)
    if kind == '.ply':
        write_ply(path, {axis: XYZ[:, i] for i, axis in enumerate('xyz')} | {'label': np.arange(30, dtype=np.int32)})
    elif kind == '.npy':
        np.save(path, XYZ)
    elif kind == '.npz':
        np.savez_compressed(path, xyz=XYZ, label=np.arange(30))
    elif kind == '.bin':
        np.c_[XYZ, XYZ[:, 0]].astype('<f4').tofile(path)
    elif kind == '.pcd':
        head = 'FIELDS x y z _\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT 1 1 1 4\nWIDTH 30\nHEIGHT 1\nPOINTS 30\nDATA binary\n'
        path.write_bytes(head.encode() + np.c_[XYZ, XYZ[:, 0]].astype('<f4').tobytes())
    elif kind == '.pts':
        path.write_text(f'20\n{rows[: 20 * 18]}' + f'10\n{rows[20 * 18 :]}\n')
    elif kind == '.ptx':
        path.write_text(f'6\n5\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n{rows}\n')
    else:
        path.write_text(('x,y,z\n' + rows.replace(' ', ',')) if kind == '.csv' else f'# x y z\n{rows}\n')
    return path.read_bytes()


@pytest.mark.parametrize('kind', ['.ply', '.npy', '.npz', '.bin', '.pcd', '.txt', '.csv', '.pts', '.ptx'])
def test_a_scan_or_a_message(tmp_path, kind):
    good, path = written(tmp_path, kind), tmp_path / f'bad{kind}'
    read_scan(tmp_path / f'good{kind}')  # kernels are compiled
    for case in range(CASES):
        path.write_bytes(damaged(good, np.random.default_rng([case, len(kind)])))
        began = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter('error', RuntimeWarning)
            warnings.simplefilter('ignore', UserWarning)
            try:
                scan = read_scan(path, labels=True)
            except SceneError as error:
                assert str(path) in str(error), (case, error)
            else:
                assert np.isfinite(scan.cloud.xyz).all() and len(scan.cloud) > 0, case
        assert time.process_time() - began < 5, case
