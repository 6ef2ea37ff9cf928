"""Scans with faults, through whole commands."""

import numpy as np
import pytest
from runs.random_segmentor import make_checkpoint, make_scan

from rm3d_plugin.inference.oversegment import oversegment_file
from rm3d_plugin.inference.predict import predict_files
from rm3d_plugin.storage.ply import read_ply, write_ply
from rm3d_plugin.storage.scans import read_scan

UTM = (468_123.0, 5_764_321.0, 80.0)


def predicted(scan, out):
    checkpoint = make_checkpoint(out / 'net.pth')
    with pytest.warns(UserWarning, match='1 of .* points lie far from all others .* at 0, 0, 0'):
        (path,) = predict_files(checkpoint, [scan], out / 'out')
    return read_scan(path, labels=True)


def test_a_stray_point_is_unknown_and_the_others_are_predicted(tmp_path):
    whole = read_ply(make_scan(tmp_path / 'whole.ply', shift=UTM))
    strayed = {name: np.insert(values, 7, 0) for name, values in whole.items()}
    found = predicted(write_ply(tmp_path / 'a.ply', strayed), tmp_path)
    assert len(found.label) == 301 and np.flatnonzero(found.label < 0).tolist() == [7]
    (path,) = predict_files(tmp_path / 'net.pth', [tmp_path / 'whole.ply'], tmp_path / 'out')
    np.testing.assert_array_equal(np.delete(found.label, 7), read_scan(path, labels=True).label)


def test_the_folder(real_data, tmp_path):
    folder = real_data / 'hard_inputs'
    if not folder.is_dir():
        pytest.skip(f'{folder} is not there')
    found = predicted(folder / 'utm_room_one_zero.ply', tmp_path)
    assert len(found.label) == 1501 and (found.label < 0).sum() == 1
    counts = [
        len(oversegment_file(folder / f'{name}.ply', tmp_path / 'regions.npz'))
        for name in ('corner', 'corner_zero_normals')
    ]
    assert counts == [6, 6]
