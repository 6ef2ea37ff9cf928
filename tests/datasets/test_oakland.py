"""Oakland's tiles: a few lines by hand, and the tiles of the real data set."""

import pickle

import numpy as np
import pytest

from rm3d_plugin.datasets import DatasetNotFoundError
from rm3d_plugin.datasets.oakland import TILES, OaklandDataset
from rm3d_plugin.datasets.oakland_format import CLASSES, IDS, MERGE, check_up, merge_ids, read_names
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.structures import SceneError

HEADER = '#Thu Aug  7 2008\n#  1103 -- utility_pole \n#  1200 -- load_bearing -- 1949 \n'
ROWS = '-16.97 -27.84 5.72 1400 2\n1 2 3 1103 2\n4 5 6 1001 2\n7 8 9 1301 0\n'


def write(root, tile='part2_ac', text=HEADER + ROWS):
    root.mkdir(exist_ok=True)
    path = root / f'oakland_{tile}.xyz_label_conf'
    path.write_text(text)
    return path


def test_a_tile_by_hand(tmp_path):
    path = write(tmp_path)
    write(tmp_path, 'part3_ao')
    dataset = DATASETS.build(
        {'type': 'rm3d_plugin.OaklandDataset', 'data_root': str(tmp_path), 'split': 'test', 'tiles': ['part3_ao'],
         'labels': 'truth'}
    )  # fmt: skip
    cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
    np.testing.assert_array_equal(cloud.xyz, np.float32([[-16.97, -27.84, 5.72], [1, 2, 3], [4, 5, 6], [7, 8, 9]]))
    assert cloud.intensity is None and cloud.colors is None and cloud.sensor is None
    assert truth.semantic.tolist() == [4, 2, -1, 3]
    assert truth.instance is None
    assert dataset.thing_classes == ()
    assert read_names(path) == {1103: 'utility_pole', 1200: 'load_bearing'}


def test_the_merge():
    assert CLASSES == ('vegetation', 'wire', 'pole', 'ground', 'facade', 'vehicle')
    merged = merge_ids(np.array([1300, 1105, 1303, 1301, 1412, 1501, 1402, 9999]), 'here')
    assert merged.tolist() == [0, 1, 2, 3, 4, 5, -1, -1]
    assert {number for numbers in MERGE.values() for number in numbers} <= IDS
    with pytest.raises(SceneError, match=r'here: label ids that Oakland does not have: 3 \(2 points\), 1700 \(1 point'):
        merge_ids(np.array([3, 1300, 3, 1700]), 'here')


def test_splits_and_missing_tiles(tmp_path):
    for tile in TILES['test']:
        write(tmp_path, tile)
    assert OaklandDataset(tmp_path, 'test').scene_ids == ('part2_ag', 'part2_ai', 'part3_ao')
    with pytest.raises(DatasetNotFoundError, match=r'no oakland_part2_ac.xyz_label_conf \(6 tiles are missing\)'):
        _ = OaklandDataset(tmp_path).scene_ids
    with pytest.raises(ValueError, match='split: expected one of train, test'):
        OaklandDataset(tmp_path, 'val')
    with pytest.raises(ValueError, match='tiles: name at least one, each once'):
        OaklandDataset(tmp_path, tiles=['part2_ac', 'part2_ac'])


def test_tiles_stay_in_memory_but_do_not_travel(tmp_path):
    path = write(tmp_path)
    dataset = OaklandDataset(tmp_path, tiles=['part2_ac'])
    first = dataset.read_scene(0)
    path.unlink()
    assert dataset.read_scene(0) is first
    with pytest.raises(SceneError, match='no such file'):
        pickle.loads(pickle.dumps(dataset)).read_scene(0)


def test_parsed_once(tmp_path):
    path = write(tmp_path / 'data')
    settings = {'tiles': ['part2_ac'], 'cache': tmp_path / 'cache'}
    first = OaklandDataset(tmp_path / 'data', **settings).load_cloud(0)
    assert len(list((tmp_path / 'cache').glob('*.npz'))) == 1
    again = OaklandDataset(tmp_path / 'data', **settings).load_cloud(0)
    np.testing.assert_array_equal(first.xyz, again.xyz)
    path.write_text(HEADER + ROWS * 2)  # another file, another key
    assert len(OaklandDataset(tmp_path / 'data', **settings).load_cloud(0)) == 8


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'holds no points'),
        (HEADER, 'holds no points'),
        (ROWS + '1 2 3 1400', 'line 5: 4 numbers, expected 5'),
        ('1 2 3 1400\n', 'line 1: 4 numbers, expected 5: .*; expected x y z label confidence'),
        (ROWS + '1 2 here 1400 2\n', "line 5: 'here' is not a number"),
        (ROWS + '1 2 3 1400.5 2\n', 'label: expected whole numbers, got 1400.5'),
        (ROWS + '1e300 2 3 1400 2\n', '1 of 5 lines hold NaN'),
        ('<html>404', 'is a web page, not .xyz_label_conf; download it again'),
        (ROWS + '1 2 nan 1400 2\n', '1 of 5 lines hold NaN'),
        ('1 2 3 4 2\n', r'label ids that Oakland does not have: 4 \(1 points\)'),
    ],
)
def test_bad_tiles_are_named(tmp_path, text, message):
    write(tmp_path, text=text)
    with pytest.raises(SceneError, match=f'oakland_part2_ac.xyz_label_conf.*{message}'):
        OaklandDataset(tmp_path, tiles=['part2_ac']).load_cloud(0)


def test_a_tile_on_its_side_is_refused():
    rng = np.random.default_rng(0)
    ground, label = rng.uniform(-20, 20, (200, 3)) * [1, 1, 0.02], np.full(200, 1200)
    check_up(ground, label, 'here')
    with pytest.raises(SceneError, match='m along y; expected z up'):
        check_up(ground[:, [0, 2, 1]], label, 'here')


def test_real_tiles(real_data):
    root = real_data / 'oakland'
    if not root.is_dir():
        pytest.skip(f'no {root}')
    counts = {}
    for split in ('train', 'test'):
        dataset = OaklandDataset(root, split)
        for index, tile in enumerate(dataset.scene_ids):
            semantic = dataset.load_truth(index).semantic
            counts[tile] = np.bincount(semantic + 1, minlength=7).tolist()
    assert counts == {
        'part2_ac': [1911, 11934, 33, 273, 69521, 13226, 3102],
        'part2_ad': [411, 12063, 0, 28, 55642, 20638, 11218],
        'part2_ae': [466, 16984, 0, 76, 69078, 11038, 2358],
        'part3_aj': [4957, 7664, 0, 35, 48034, 22769, 0],
        'part3_ak': [2431, 9290, 481, 402, 71863, 7821, 7712],
        'part3_am': [6679, 8641, 899, 1418, 67419, 13271, 1649],
        'part2_ag': [994, 29109, 144, 569, 60196, 339, 8649],
        'part2_ai': [890, 28226, 510, 1504, 66870, 0, 2000],
        'part3_ao': [169, 37936, 1631, 907, 56150, 3207, 0],
    }
    dataset = OaklandDataset(root, 'test')
    cloud, truth = dataset.load_cloud(2), dataset.load_truth(2)
    ground, wire = (cloud.xyz[truth.semantic == CLASSES.index(name), 2] for name in ('ground', 'wire'))
    assert np.median(wire) > np.median(ground) + 3


@pytest.mark.parametrize('encoding', ['utf-16', 'utf-8-sig'])
def test_tiles_of_other_programs(tmp_path, encoding):
    path = write(tmp_path)
    path.write_bytes((HEADER + ROWS).replace('\n', '\r\n').encode(encoding))
    assert read_names(path) == {1103: 'utility_pole', 1200: 'load_bearing'}
    assert OaklandDataset(tmp_path, tiles=['part2_ac'], cache=None).load_cloud(0).xyz[1].tolist() == [1, 2, 3]
    with pytest.raises(ValueError, match="tiles: expected a list of names, got 'part2_ac'"):
        OaklandDataset(tmp_path, tiles='part2_ac')
