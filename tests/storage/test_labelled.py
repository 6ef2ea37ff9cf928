from pathlib import Path

import numpy as np
import pytest

from rm3d_plugin.storage.columns import read_columns
from rm3d_plugin.storage.labelled import labelled_ending, write_labelled

ADDED = {'label': np.array([4, -1, 2], np.int32), 'confidence': np.array([0.5, 0.0, 1.0], np.float32)}


@pytest.mark.parametrize(
    ('name', 'ending'), [('a.PLY', '.ply'), ('a.las', '.las'), ('a.npz', '.npz'), ('a.pcd', '.ply'), ('a.txt', '.ply')]
)
def test_ending(name, ending):
    assert labelled_ending(Path(name)) == ending


def test_a_table_becomes_ply_with_its_columns(tmp_path):
    source = tmp_path / 'a.csv'
    source.write_text('x,y,z,label,scalar_label,input_label\n0,0,0,9,8,7\n1,0,0,9,8,7\n2,0,0.5,9,8,7\n')
    written = write_labelled(source, tmp_path / 'a.ply', read_columns(source), ADDED)
    after = read_columns(written)
    assert after['z'].tolist() == [0.0, 0.0, 0.5]
    assert [after[name][0] for name in ('input_input_label', 'input_scalar_label', 'input_label')] == [9, 8, 7]
    for name, values in ADDED.items():
        np.testing.assert_array_equal(after[name], values)


def test_whole_numbers_of_64_bits_fit_into_ply(tmp_path):
    columns = {axis: np.zeros(3) for axis in 'xyz'} | {'id': np.array([1, 2, 3]), 'time': np.array([0, 1, 2**40])}
    columns |= {'a flag': np.array([True, False, True])}
    after = read_columns(write_labelled(tmp_path / 'a.npy', tmp_path / 'a.ply', columns, ADDED))
    assert after['id'].dtype == np.int32 and after['id'].tolist() == [1, 2, 3]
    assert after['time'].tolist() == [0.0, 1.0, 2.0**40]
    assert after['a_flag'].tolist() == [1, 0, 1]


def test_an_archive_keeps_its_arrays(tmp_path):
    source = tmp_path / 'a.npz'
    arrays = {'xyz': np.arange(9.0).reshape(3, 3), 'rgb': np.ones((3, 3), np.uint8), 'name': np.array('hall')}
    np.savez(source, **arrays)
    written = write_labelled(source, tmp_path / 'out' / 'a.npz', read_columns(source), ADDED)
    with np.load(written) as after:
        for name, values in {**arrays, **ADDED}.items():
            np.testing.assert_array_equal(after[name], values)
            assert after[name].dtype == values.dtype
    again = write_labelled(written, tmp_path / 'b.npz', read_columns(written), ADDED)
    assert 'input_label' in read_columns(again)
