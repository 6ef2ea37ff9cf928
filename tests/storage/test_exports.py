import builtins

import numpy as np
import pytest

from rm3d_plugin.storage.exports import write_instance_text, write_label_words, write_las, write_numbers
from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.structures import SceneError


def test_numbers_one_a_line(tmp_path, monkeypatch):
    monkeypatch.setattr('rm3d_plugin.storage.exports._LINES', 3)
    path = write_numbers(tmp_path / 'a' / 'x.txt', np.array([5, 0, -1, 39, 2, 2, 7]))
    assert path.read_text() == '5\n0\n-1\n39\n2\n2\n7\n'
    assert write_numbers(tmp_path / 'none.txt', np.zeros(0, dtype=np.int64)).read_text() == ''


def test_instances_as_text(tmp_path):
    masks = np.array([[True, False, True], [False, True, False]])
    files = write_instance_text(tmp_path / 'scene0.txt', masks, np.array([5, 39]), np.array([0.91234, 0.5]))
    assert files[0].read_text() == 'predicted_masks/scene0_000.txt 5 0.9123\npredicted_masks/scene0_001.txt 39 0.5000\n'
    assert [file.read_text() for file in files[1:]] == ['1\n0\n1\n', '0\n1\n0\n']
    none = write_instance_text(tmp_path / 'none.txt', masks[:0], np.zeros(0, dtype=int), np.zeros(0))
    assert [file.read_text() for file in none] == ['']


def test_label_words(tmp_path):
    path = write_label_words(tmp_path / 'x.label', np.array([10, 0, 81]), np.array([1, 0, 65535]))
    assert np.fromfile(path, dtype='<u4').tolist() == [10 + (1 << 16), 0, 81 + (65535 << 16)]
    with pytest.raises(ValueError, match='instance: expected numbers of 16 bits, got 0 to 65536'):
        write_label_words(path, np.array([0, 0]), np.array([0, 65536]))


@pytest.mark.parametrize('ending', ['.las', '.laz'])
def test_las_with_utm_coordinates(tmp_path, ending):
    pytest.importorskip('laspy')
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 100, (50, 3)) + [468_123.0, 5_764_321.0, 80.0]
    label = rng.integers(-1, 300, 50)
    path = tmp_path / f'x{ending}'
    confidence = rng.random(50).astype(np.float32)
    write_las(path, xyz, np.full((50, 3), 0.25), label, {'confidence': confidence}, ('wall', 'floor'))
    scan = read_scan(path, labels=True)
    np.testing.assert_allclose(scan.cloud.xyz.astype(np.float64) + scan.cloud.origin, xyz, atol=1.1e-4)
    assert scan.label.tolist() == label.tolist()
    np.testing.assert_allclose(scan.cloud.colors, 0.25, atol=1e-4)
    import laspy

    las = laspy.read(path)
    expected = [64 + k if 0 <= k < 192 else 1 for k in label.tolist()]
    assert np.asarray(las.classification).tolist() == expected
    np.testing.assert_array_equal(np.asarray(las['confidence']), confidence)


def test_las_of_no_points_and_of_very_wide_ones(tmp_path):
    pytest.importorskip('laspy')
    empty = write_las(tmp_path / 'e.las', np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=int))
    assert empty.stat().st_size > 300
    wide = np.array([[-1e7, 0, 0], [1e7, 1, 2.5]])
    scan = read_scan(write_las(tmp_path / 'w.las', wide, np.zeros((2, 3)), np.array([0, 1])))
    np.testing.assert_allclose(scan.cloud.xyz + scan.cloud.origin, wide, atol=1.0)


def test_without_laspy_the_extra_is_named(tmp_path, monkeypatch):
    real = builtins.__import__

    def absent(name, *rest, **named):
        if name == 'laspy':
            raise ImportError(name)
        return real(name, *rest, **named)

    monkeypatch.setattr(builtins, '__import__', absent)
    with pytest.raises(SceneError, match=r'pip install "rm3d_plugin\[las\]"'):
        write_las(tmp_path / 'x.las', np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1, dtype=int))
    assert list(tmp_path.iterdir()) == []
