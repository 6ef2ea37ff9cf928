"""Damaged files of every kind: a scan, or a message that names the file; no other error, no waiting.

``make fuzz`` tries many more (RM3D_FUZZ = cases of each kind).
"""

import os
import time
import warnings

import numpy as np
import pytest

from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.structures import SceneError

CASES = int(os.environ.get('RM3D_FUZZ', '40'))
RNG = np.random.default_rng(0)
XYZ = RNG.random((30, 3)) * 9
TOKENS = (b'-1', b'1e999', b'nan', b'999999999999', b'list uchar int', b';', b',', b'\n', b'\x00', b'"', b'#', b'\xff')


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


def damaged(data, rng):
    """The bytes cut, flipped, repeated, or with a telling token written into them, most often near the front."""
    data, way = bytearray(data), rng.integers(5)
    at = int(rng.integers(len(data)) if rng.random() < 0.5 else rng.integers(min(len(data), 250)))
    if way == 0:
        return bytes(data[:at])
    if way == 1:
        for place in rng.integers(len(data), size=rng.integers(1, 9)):
            data[place] ^= 1 << int(rng.integers(8))
    elif way == 2:
        data[at:at] = data[at : at + int(rng.integers(1, 200))]
    else:
        token = TOKENS[rng.integers(len(TOKENS))]
        data[at : at + (len(token) if way == 3 else 0)] = token
    return bytes(data)


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
