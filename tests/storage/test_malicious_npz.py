"""Archives of strangers: no code of theirs runs, no room is made for what they only promise, no path leads out."""

import io
import tracemalloc
import warnings
import zipfile

import numpy as np
import pytest

from rm3d_plugin.commands.main import run
from rm3d_plugin.label_budgets.point_lists import read_point_list
from rm3d_plugin.oversegmentation.precomputed import Precomputed
from rm3d_plugin.storage import read_npz
from rm3d_plugin.storage.npy import read_array
from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.structures import PointCloud
from rm3d_plugin.user_error import UserError


class Touch:
    """Pickled, it makes a file when it is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), 'w')


def regions_of(path):
    part = Precomputed(files=str(path.with_stem('{scene}')))
    return part.partition(PointCloud(np.ones((9, 3))), None, None, path.stem)


READERS = {
    'scan': read_scan,
    'store': read_npz,
    'regions': lambda path: regions_of(path),
}


@pytest.mark.parametrize('reader', READERS)
@pytest.mark.parametrize('ending', ['.npz', '.npy'])
def test_pickles_in_arrays_are_not_opened(tmp_path, reader, ending):
    ran, path = tmp_path / 'ran', tmp_path / f'evil{ending}'
    evil = np.array([Touch(ran)] * 9, dtype=object)
    if ending == '.npy':
        np.save(path, evil, allow_pickle=True)
    else:
        np.savez(path, xyz=np.ones((9, 3)), labels=evil, points=evil)
    with pytest.raises(UserError, match=path.name):
        READERS[reader](path)
    assert not ran.exists()


def promising(count):
    """The header of so many numbers, and three of them."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {'descr': '<f8', 'fortran_order': False, 'shape': (count, 3)})
    return file.getvalue() + np.zeros(3).tobytes()


@pytest.mark.parametrize('count', [10**7, 10**15])
@pytest.mark.parametrize('reader', READERS)
@pytest.mark.parametrize('ending', ['.npz', '.npy'])
def test_no_room_is_made_for_what_is_only_promised(tmp_path, reader, ending, count):
    path = tmp_path / f'evil{ending}'
    path.write_bytes(promising(count))
    if ending == '.npz':
        with zipfile.ZipFile(path, 'w') as archive:
            for name in ('xyz', 'labels'):
                archive.writestr(f'{name}.npy', promising(count))
    tracemalloc.start()
    try:
        with pytest.raises(UserError, match=path.name):
            READERS[reader](path)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_arrays_of_every_version_are_read():
    for values in (np.arange(6).reshape(2, 3), np.asfortranarray(np.ones((3, 2))), np.zeros(2, dtype=[('ä', 'f4')])):
        file = io.BytesIO()
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # that the last needs version 3
            np.save(file, values)
        size = file.tell()
        file.seek(0)
        np.testing.assert_array_equal(read_array(file, size), values)


def test_names_of_arrays_lead_nowhere(tmp_path, capsys):
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 2, (200, 3))
    folder = tmp_path / 'in' / 'deep'
    folder.mkdir(parents=True)
    np.savez(folder / 'a.npz', xyz=xyz, **{'../../../evil': np.arange(200)})
    (folder / 'clicks.csv').write_text('scene,index,class\na,0,low\na,1,high\n')
    words = ['--clicks', folder / 'clicks.csv', '--out', folder / 'out', '--format', 'same', '--no-check']
    code = run('label', [str(word) for word in (folder / 'a.npz', *words)])
    told = capsys.readouterr().err
    assert code in (0, 2) and 'Traceback' not in told
    outside = [path for path in tmp_path.rglob('*') if 'evil' in path.name]
    assert not outside


def test_lists_of_points_run_nothing(tmp_path):
    ran, path = tmp_path / 'ran', tmp_path / 'list.npz'
    np.savez(path, room=np.array([Touch(ran)], dtype=object))
    with pytest.raises(UserError, match=r'list\.npz'):
        read_point_list(path)
    assert not ran.exists()
