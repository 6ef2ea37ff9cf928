"""Semantic3D's text: pieces give what the whole gives, memory does not grow with the file, and bad files are named."""

import tracemalloc
from collections import Counter

import numpy as np
import pytest

from rm3d_plugin.datasets import DatasetNotFoundError
from rm3d_plugin.datasets.semantic3d import HOLDOUT, TESTING, TRAINING, Semantic3DDataset
from rm3d_plugin.datasets.semantic3d_format import thin_scene
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.structures import SceneError

# Two voxels of 1 m: the first has labels 5, 0, 0, 0 and 3, 3; the second only 0.
TEXT = """0.1 0.1 0.1 -2048 255 0 51
0.2 0.2 0.2 2047 0 0 0
1.5 0.5 0.5 0 1 2 3
0.3 0.3 0.3 5 9 9 9
0.4 0.4 0.4 5 9 9 9
0.5 0.5 0.5 5 9 9 9
0.6 0.6 0.6 5 9 9 9
"""
LABELS = '5\n0\n0\n0\n3\n3\n0\n'


def write(root, station='sg27_station4', text=TEXT, labels=LABELS, suffix='_intensity_rgb'):
    root.mkdir(exist_ok=True, parents=True)
    (root / f'{station}{suffix}.txt').write_text(text)
    if labels is not None:
        (root / f'{station}{suffix}.labels').write_text(labels)
    return root / f'{station}{suffix}.txt'


def one(root, **arguments):
    return Semantic3DDataset(root, stations=['sg27_station4'], voxel_downsample=1.0, **arguments)


def slow_twin(rows, labels, size):
    """Dictionary of voxels."""
    first, votes, number = {}, {}, []
    for i, row in enumerate(rows):
        cell = tuple(np.floor(row[:3] / size))
        first.setdefault(cell, i)
        votes.setdefault(cell, Counter()).update([labels[i]] if labels[i] else [])
        number.append(list(first).index(cell))
    best = [min((-n, label) for label, n in v.items())[1] - 1 if v else -1 for v in votes.values()]
    return list(first.values()), best, number


def random_station(seed, count):
    rng = np.random.default_rng(seed)
    xyz = np.round(rng.uniform(-3, 3, (count, 3)), 3)
    rows = np.column_stack([xyz, rng.integers(-2048, 2048, count), rng.integers(0, 256, (count, 3))])
    return rows, rng.integers(0, 9, count)


def as_text(rows, labels):
    text = ''.join(f'{x:.3f} {y:.3f} {z:.3f} {i:.0f} {r:.0f} {g:.0f} {b:.0f}\n' for x, y, z, i, r, g, b in rows)
    return text, ''.join(f'{label}\n' for label in labels)


@pytest.mark.parametrize('cached', [False, True])
def test_a_station_by_hand(tmp_path, cached):
    write(tmp_path / 'data')
    config = {
        'type': 'rm3d_plugin.Semantic3DDataset', 'data_root': str(tmp_path / 'data'), 'split': 'val',
        'stations': ['sg27_station4'], 'voxel_downsample': 1.0, 'labels': 'truth',
        'cache': str(tmp_path / 'cache') if cached else None,
    }  # fmt: skip
    for _ in range(2):
        dataset = DATASETS.build(config)
        cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
        np.testing.assert_allclose(cloud.xyz, [[0.1, 0.1, 0.1], [1.5, 0.5, 0.5]], atol=1e-7)
        np.testing.assert_allclose(cloud.colors, [[1, 0, 0.2], [1 / 255, 2 / 255, 3 / 255]], atol=1e-7)
        np.testing.assert_allclose(cloud.intensity, [0, 2048 / 4095], atol=1e-7)
        assert truth.semantic.tolist() == [2, -1]  # label 3 wins over 5; unlabelled points have no say
        assert truth.instance is None and dataset.thing_classes == ()
        assert dataset.original_index(0).tolist() == [0, 0, 1, 0, 0, 0, 0]
        assert dataset[0]['points'].shape == (2, 7)


@pytest.mark.parametrize('chunk', [64, 1000, 1 << 20])
def test_pieces_equal_the_slow_twin(tmp_path, chunk):
    rows, labels = random_station(1, 400)
    path = write(tmp_path, text=as_text(rows, labels)[0], labels=as_text(rows, labels)[1])
    pieces = []
    scene = thin_scene(path, path.with_suffix('.labels'), 1.5, pieces.append, chunk)
    kept, best, number = slow_twin(rows, labels, 1.5)
    np.testing.assert_array_equal(scene.xyz, rows[kept, :3])
    assert scene.semantic.tolist() == best
    np.testing.assert_array_equal(np.concatenate(pieces), number)
    assert scene.num_points == 400


def test_memory_does_not_grow_with_the_file(tmp_path):
    rows, labels = random_station(2, 4000)
    text, marks = as_text(rows, labels)
    thin_scene(write(tmp_path), None, 1.0)  # compiles
    peaks = []
    for times in (5, 40):
        path = write(tmp_path, text=text * times, labels=marks * times)
        tracemalloc.start()
        scene = thin_scene(path, path.with_suffix('.labels'), 0.5, chunk=1 << 17)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert scene.num_points == 4000 * times
    assert peaks[1] < 1.1 * peaks[0]
    assert peaks[1] < 4e6 < 4000 * 40 * 56  # bytes, far below the table of the whole file


def test_large_coordinates_lose_nothing(tmp_path):
    text = '448262.123 5411932.456 250.789 0 1 2 3\n448262.323 5411932.456 250.789 0 1 2 3\n'
    write(tmp_path, text=text, labels=None)
    cloud = Semantic3DDataset(tmp_path, stations=['sg27_station4']).load_cloud(0)
    np.testing.assert_allclose(cloud.xyz + cloud.origin, [[448262.123, 5411932.456, 250.789],
                                                          [448262.323, 5411932.456, 250.789]], atol=1e-4)  # fmt: skip


def test_lost_and_damaged_pieces_are_made_again(tmp_path):
    write(tmp_path / 'data')
    dataset = one(tmp_path / 'data', cache=tmp_path / 'cache')
    expected = dataset.original_index(0).tolist()
    (piece,) = (tmp_path / 'cache').glob('*.00000.npz')
    piece.unlink()
    assert one(tmp_path / 'data', cache=tmp_path / 'cache').original_index(0).tolist() == expected
    piece.write_bytes(b'cut off')
    assert one(tmp_path / 'data', cache=tmp_path / 'cache').original_index(0).tolist() == expected


def test_the_official_splits(tmp_path):
    assert len(TRAINING) == len(set(TRAINING)) == 15
    assert {name: len(stations) for name, stations in TESTING.items()} == {'semantic-8': 15, 'reduced-8': 4}
    assert set(TESTING['reduced-8']) < set(TESTING['semantic-8'])
    for station in TRAINING:
        write(tmp_path / station, station)
    for station in TESTING['semantic-8']:
        write(tmp_path, station, labels=None)
    for station in TESTING['reduced-8']:
        write(tmp_path, station.replace('station', 'Station'), labels=None, suffix='_rgb_intensity-reduced')
    assert Semantic3DDataset(tmp_path, 'trainval').scene_ids == TRAINING
    assert Semantic3DDataset(tmp_path, 'val').scene_ids == HOLDOUT
    assert len(Semantic3DDataset(tmp_path).scene_ids) == 12
    assert len(Semantic3DDataset(tmp_path, holdout=[]).scene_ids) == 15
    dataset = Semantic3DDataset(tmp_path, 'test')
    assert dataset.scene_ids == TESTING['semantic-8']
    assert all('reduced' not in dataset._files(i)[0].name for i in range(15))
    # station 1 is not station 10
    assert dataset._files(9)[0].name == 'sg27_station10_intensity_rgb.txt'
    reduced = Semantic3DDataset(tmp_path, 'test', 'reduced-8')
    assert len(reduced) == 4 and all('reduced' in reduced._files(i)[0].name for i in range(4))
    with pytest.raises(SceneError, match='keeps the labels of its test stations'):
        reduced.load_truth(0)


def test_half_written_folders_are_passed_over(tmp_path):
    write(tmp_path / '.sg27_station4.tmp1', text='1 2')
    write(tmp_path / 'sg27_station4')
    assert len(one(tmp_path).load_cloud(0)) == 2


def test_missing_stations_and_bad_choices(tmp_path):
    write(tmp_path, labels=None)
    with pytest.warns(UserWarning, match="11 of 12 stations of split 'train' are not there"):
        assert Semantic3DDataset(tmp_path).scene_ids == ('sg27_station4',)
    with pytest.raises(DatasetNotFoundError, match=r'(?s)there is no bildstein_station5.*\.labels.*--demo'):
        _ = Semantic3DDataset(tmp_path, 'val').scene_ids
    with pytest.raises(SceneError, match=r'sg27_station4_intensity_rgb.labels: no such file'):
        one(tmp_path).load_truth(0)
    with pytest.raises(ValueError, match='benchmark: expected one of semantic-8, reduced-8'):
        Semantic3DDataset(tmp_path, benchmark='8')
    with pytest.raises(ValueError, match='voxel_downsample: expected metres > 0'):
        Semantic3DDataset(tmp_path, voxel_downsample=0)
    with pytest.raises(ValueError, match='holdout: expected training stations, got sg27_station3'):
        Semantic3DDataset(tmp_path, holdout=['sg27_station3'])


@pytest.mark.parametrize(
    ('text', 'labels', 'message'),
    [
        ('', '', r'rgb.txt: holds no points'),
        (TEXT + '1 2 3 4', LABELS, r'rgb.txt, line 8: 4 numbers, expected 7; expected x y z intensity r g b'),
        (TEXT + '1 2 x 4 5 6 7\n', LABELS, r"rgb.txt, line 8: 'x' is not a number"),
        (TEXT + '1 2 nan 4 5 6 7\n', LABELS, r'rgb.txt: point 8 holds NaN'),
        (TEXT + '1 2 3 4 5 6 256\n', LABELS, r'rgb.txt: colours outside 0 to 255'),
        (TEXT + '9e9 2 3 4 5 6 7\n', LABELS + '1\n', r'rgb.txt: thinning to 1.0 m: a point lies'),
        (TEXT, LABELS[:-2], r'rgb.labels: 6 labels, but .*rgb.txt has more points'),
        (TEXT, LABELS + '1\n1\n', r'rgb.labels: 9 labels, but .*rgb.txt has 7 points'),
        (TEXT, LABELS.replace('5', '9'), r'rgb.labels: unknown labels 9 \(1 points\); Semantic3D has 0'),
        (TEXT, LABELS.replace('5', '1.5'), r'rgb.labels: unknown labels 1.5 \(1 points\)'),
        (TEXT, LABELS.replace('5', '1 2'), r'rgb.labels, line 1: 2 numbers, expected 1'),
    ],
)
def test_bad_files_are_named(tmp_path, text, labels, message):
    write(tmp_path, text=text, labels=labels)
    with pytest.raises(SceneError, match=message):
        one(tmp_path).load_cloud(0)


def test_a_second_copy_of_a_station_is_told(tmp_path):
    path = write(tmp_path)
    path.with_name('sg27_station4_intensity_rgb (1).txt').write_text(TEXT)
    with pytest.raises(SceneError, match=r'a second file of sg27_station4 beside .*keep one of them'):
        len(one(tmp_path))
    with pytest.raises(ValueError, match='stations: name each once'):
        Semantic3DDataset(tmp_path, stations=['sg27_station4', 'sg27_station4'])


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        (
            TEXT.replace('255 0 51', '0.5 0 1').replace('1 2 3', '0 0 1').replace('9 9 9', '0 1 1'),
            'colours from 0 to 1',
        ),
        (TEXT.replace('1.5', '1e300'), 'point 3 holds NaN or an infinite number'),
        ("7z\xbc\xaf'\x1c\n", 'is a 7z archive, not .txt; unpack it first'),
    ],
)
def test_values_of_another_kind_are_told(tmp_path, text, told):
    write(tmp_path).write_bytes(text.encode('latin-1'))
    with pytest.raises(SceneError, match=told):
        one(tmp_path).load_cloud(0)


def test_intensities_of_another_scanner_are_cut_aloud(tmp_path):
    write(tmp_path)
    as_is = one(tmp_path).load_cloud(0).intensity
    write(tmp_path, text=TEXT.replace('2047', '5000'))
    with pytest.warns(UserWarning, match=r'rgb.txt: intensities beyond -2048 to 2047 are taken for these'):
        cloud = one(tmp_path).load_cloud(0)
    np.testing.assert_array_equal(cloud.intensity, as_is)


def test_marks_before_text_and_labels(tmp_path):
    path = write(tmp_path)
    truth = one(tmp_path).load_truth(0).semantic
    for file in (path, path.with_suffix('.labels')):
        file.write_bytes(b'\xef\xbb\xbf' + file.read_bytes())
        file.rename(file.with_suffix(file.suffix.upper()))
    (tmp_path / 'README.TXT').write_text('')
    np.testing.assert_array_equal(one(tmp_path).load_truth(0).semantic, truth)
