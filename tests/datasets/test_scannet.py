"""ScanNet's native files, a scan of eight vertices worked by hand."""

import json
import pickle

import numpy as np
import pytest

from rm3d_plugin.datasets import DatasetNotFoundError
from rm3d_plugin.datasets.scannet import ScanNetDataset
from rm3d_plugin.datasets.scannet_format import CLASSES, NYU40_IDS, class_of_nyu40, read_label_map
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.structures import SceneError

SCAN = 'scene0000_00'
XYZ = np.array([[i, 2 * i, 0.5 * i] for i in range(8)], dtype=np.float32)
RGB = np.array([[10 * i, 255 - i, 3] for i in range(8)], dtype=np.uint8)
SEGMENTS = [5, 5, 9, 9, 2, 2, 7, 30]
# objects: a wall (segment 5), a chair (9), another chair (2), a cushion (7: nyu40 18, outside the benchmark)
GROUPS = [('wall', [5]), ('office chair', [9]), ('chair', [2]), ('cushion', [7])]
TSV = 'id\traw_category\tcategory\tnyu40id\n1\twall\twall\t1\n2\tchair\tchair\t5\n'
TSV += '7\toffice chair\tchair\t5\n39\tcushion\tcushion\t18\n'
NYU = np.array([1, 1, 5, 5, 5, 5, 18, 0], dtype=np.uint16)
RAW = np.array([1, 1, 7, 7, 2, 2, 39, 0], dtype=np.uint16)
SEMANTIC = [0, 0, 4, 4, 4, 4, -1, -1]
INSTANCE = [-1, -1, 0, 0, 1, 1, -1, -1]
MATRIX = np.array([[0, -1, 0, 3], [1, 0, 0, -2], [0, 0, 1, 0.5], [0, 0, 0, 1]], dtype=float)


def mesh_bytes(xyz=XYZ, rgb=RGB, faces=((0, 1, 2),)):
    """As ScanNet writes it: colours with alpha, faces as lists after the vertices."""
    head = f'ply\nformat binary_little_endian 1.0\ncomment MLIB generated\nelement vertex {len(xyz)}\n'
    head += ''.join(f'property float {a}\n' for a in 'xyz')
    head += ''.join(f'property uchar {c}\n' for c in ('red', 'green', 'blue', 'alpha'))
    head += f'element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n'
    rows = np.zeros(len(xyz), dtype=[('p', '<f4', 3), ('c', 'u1', 4)])
    rows['p'], rows['c'][:, :3] = xyz, rgb
    return head.encode() + rows.tobytes() + b''.join(b'\x03' + np.array(f, '<i4').tobytes() for f in faces)


def write_scan(root, scan=SCAN, labels=NYU, folder='scans'):
    base = root / folder / scan
    base.mkdir(parents=True)
    (base / f'{scan}_vh_clean_2.ply').write_bytes(mesh_bytes())
    if labels is not None:
        columns = {a: XYZ[:, i] for i, a in enumerate('xyz')} | {'label': labels}
        write_ply(base / f'{scan}_vh_clean_2.labels.ply', columns)
    groups = [{'id': i, 'objectId': i, 'segments': s, 'label': n} for i, (n, s) in enumerate(GROUPS)]
    (base / f'{scan}.aggregation.json').write_text(json.dumps({'sceneId': scan, 'segGroups': groups}))
    (base / f'{scan}_vh_clean_2.0.010000.segs.json').write_text(json.dumps({'segIndices': SEGMENTS}))
    (base / f'{scan}.txt').write_text(
        'appVersionId = 50\naxisAlignment = ' + ' '.join(map(str, MATRIX.ravel())) + ' \nsceneType = Office\n'
    )
    return base


@pytest.fixture
def world(tmp_path):
    write_scan(tmp_path)
    (tmp_path / 'scannetv2_train.txt').write_text(SCAN + '\n')
    (tmp_path / 'scannetv2_val.txt').write_text(SCAN + '\n')
    (tmp_path / 'scannetv2-labels.combined.tsv').write_text(TSV)
    return tmp_path


def test_the_scan_by_hand(world):
    dataset = DATASETS.build({'type': 'rm3d_plugin.ScanNetDataset', 'data_root': str(world)})
    cloud, truth = dataset.load_cloud(0), dataset.load_truth(0)
    assert dataset.scene_ids == (SCAN,)
    # turned by 90 degrees: x' = 3 - y, y' = x - 2, z' = z + 0.5
    np.testing.assert_array_equal(cloud.xyz, np.c_[3 - XYZ[:, 1], XYZ[:, 0] - 2, XYZ[:, 2] + 0.5])
    np.testing.assert_array_equal(cloud.colors, (RGB / 255).astype(np.float32))
    assert truth.semantic.tolist() == SEMANTIC and truth.instance.tolist() == INSTANCE
    assert truth.semantic.dtype == truth.instance.dtype == np.int64 and len(truth.boxes) == 0
    assert dataset.thing_classes == tuple(range(2, 20)) and dataset.classes == CLASSES
    assert dataset.original_index(0).tolist() == list(range(8))
    raw = ScanNetDataset(world, align=False)
    np.testing.assert_array_equal(raw.load_cloud(0).xyz, XYZ)


def test_benchmark_ids():
    assert len(CLASSES) == len(NYU40_IDS) == 20
    got = class_of_nyu40(np.arange(41))
    assert [int(i) for i in np.flatnonzero(got >= 0)] == [*range(1, 13), 14, 16, 24, 28, 33, 34, 36, 39]
    assert got[list(NYU40_IDS)].tolist() == list(range(20))
    names = dict(zip(NYU40_IDS, CLASSES, strict=True))  # from the NYU40 list itself
    assert (names[7], names[14], names[24], names[28], names[36], names[39]) == (
        'table', 'desk', 'refrigerator', 'shower curtain', 'bathtub', 'otherfurniture'
    )  # fmt: skip


@pytest.mark.parametrize('labels', [None, RAW, (RAW + 100 * (RAW > 0)).astype(np.uint16)])
def test_without_label_file_or_with_raw_ids_the_objects_give_the_classes(tmp_path, labels):
    write_scan(tmp_path, labels=labels)
    (tmp_path / 'scannetv2_train.txt').write_text(SCAN)
    (tmp_path / 'scannetv2-labels.combined.tsv').write_text(TSV)
    dataset = ScanNetDataset(tmp_path)
    assert dataset.load_truth(0).semantic.tolist() == SEMANTIC
    assert dataset.load_truth(0).instance.tolist() == INSTANCE
    if labels is not None and labels.max() > 40:
        with pytest.raises(SceneError, match="label: expected NYU40 ids from 0 to 40, got 139.*label_source='aggreg"):
            ScanNetDataset(tmp_path, label_source='ply').load_truth(0)


def test_the_label_map_is_needed_only_where_names_are(world):
    (world / 'scannetv2-labels.combined.tsv').unlink()
    assert ScanNetDataset(world).load_truth(0).semantic.tolist() == SEMANTIC
    with pytest.raises(SceneError, match='labels.combined.tsv: no such file'):
        ScanNetDataset(world, label_source='aggregation').load_truth(0)


def test_the_map_by_raw_id(world):
    assert read_label_map(world / 'scannetv2-labels.combined.tsv', 'id') == {'1': 1, '2': 5, '7': 5, '39': 18}


def test_an_object_listed_twice_counts_once(world):
    path = world / 'scans' / SCAN / f'{SCAN}.aggregation.json'
    content = json.loads(path.read_text())
    content['segGroups'] += content['segGroups']
    path.write_text(json.dumps(content))
    truth = ScanNetDataset(world).load_truth(0)
    assert truth.instance.tolist() == INSTANCE and truth.semantic.tolist() == SEMANTIC


def test_test_split_has_points_only(world):
    base = write_scan(world, 'scene0707_00', folder='scans_test')
    for path in base.iterdir():
        if not path.name.endswith('_vh_clean_2.ply'):
            path.unlink()
    (world / 'scannetv2_test.txt').write_text('scene0707_00')
    dataset = ScanNetDataset(world, split='test', labels='none')
    np.testing.assert_array_equal(dataset[0]['points'][:, :3], XYZ)
    with pytest.raises(SceneError, match='scene0707_00: ScanNet keeps the labels of its test scans to itself'):
        dataset.load_truth(0)


def test_thinned_scans_keep_the_way_back(world):
    dataset = ScanNetDataset(world, split='val', labels='truth', align=False, voxel_downsample=2.0)
    # cells of 2 m: (0,0,0) (0,1,0) (1,2,0) (1,3,0) (2,4,1) (2,5,1) (3,6,1) (3,7,1): none is shared; 4 m shares
    assert len(dataset.load_cloud(0)) == 8
    dataset = ScanNetDataset(world, split='val', labels='truth', align=False, voxel_downsample=4.0)
    rows = dataset.original_index(0)
    assert rows.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    item = dataset[0]
    np.testing.assert_array_equal(item['points'][:, :3], XYZ[::2])
    assert item['semantic'].tolist() == [0, 4, 4, -1] and item['instance'].tolist() == [-1, 0, 1, -1]
    assert np.array(item['semantic'])[rows].tolist() == [0, 0, 4, 4, 4, 4, -1, -1]
    assert pickle.loads(pickle.dumps(dataset))._last is None


def test_truth_never_reaches_training(world):
    with pytest.raises(ValueError, match="labels='truth' is for splits that metrics are measured on"):
        ScanNetDataset(world, split='train', labels='truth')


def test_layout_help(tmp_path):
    with pytest.raises(DatasetNotFoundError, match='there is no folder scans(.|\n)*aggregation.json'):
        len(ScanNetDataset(tmp_path))
    (tmp_path / 'scans').mkdir()
    with pytest.raises(DatasetNotFoundError, match='there is no list .*scannetv2_val.txt'):
        len(ScanNetDataset(tmp_path, split='val'))
    (tmp_path / 'scannetv2_val.txt').write_text('a\nb a')
    with pytest.raises(SceneError, match='3 scans, 1 of them twice'):
        len(ScanNetDataset(tmp_path, split='val'))
    (tmp_path / 'one.txt').write_text('a')
    with pytest.raises(SceneError, match='scans/a: no such folder, but .*one.txt lists a'):
        ScanNetDataset(tmp_path, ann_file='one.txt').load_cloud(0)
    with pytest.raises(ValueError, match='split: expected one of train, val, test'):
        ScanNetDataset(tmp_path, split='trainval')


SEGS, AGG, PLY, LAB = '_vh_clean_2.0.010000.segs.json', '.aggregation.json', '_vh_clean_2.ply', '_vh_clean_2.labels.ply'


@pytest.mark.parametrize(
    ('ending', 'content', 'message'),
    [
        (PLY, None, 'no such file'),
        (PLY, mesh_bytes()[:300], 'bytes after the header'),
        (PLY, mesh_bytes().replace(b'uchar green', b'uchar gruen'), 'vertices have no property green'),
        (PLY, mesh_bytes(xyz=np.where(XYZ == 3, np.nan, XYZ)), r'2 of 8 vertices are NaN'),
        (PLY, mesh_bytes(XYZ[:0], RGB[:0], ()), 'holds no points'),
        (SEGS, None, 'no such file; expected the segment of each vertex'),
        (SEGS, b'{"segIndices": [1, 2]}', 'segIndices: 2 numbers, the mesh has 8 vertices'),
        (SEGS, b'{"segIndices": ["a"]}', 'segIndices: expected a list of whole numbers'),
        (SEGS, b'{}', 'no list segIndices'),
        (AGG, b'{"segGroups": [', 'not readable as JSON'),
        (AGG, b'{"segGroups": [{"label": "wall"}]}', r'segGroups\[0\]: expected label and segments'),
        (AGG, b'{"segGroups": [{"label": "wall", "segments": [1e999]}]}', r'segGroups\[0\]: expected label and seg'),
        (AGG, b'{"segGroups": [{"label": "spaceship", "segments": [5]}]}', "label 'spaceship' is not in scannetv2-lab"),
        (LAB, mesh_bytes(), 'vertices have no property label'),
        ('.txt', None, 'expected axisAlignment, or pass align=False'),
        ('.txt', b'axisAlignment = 1 0 0', 'axisAlignment: expected 16 finite numbers'),
        ('.txt', b'axisAlignment = ' + b'one ' * 16, 'axisAlignment: .*expected 16 numbers'),
    ],
)  # fmt: skip
def test_bad_files_are_named(world, ending, content, message):
    path = world / 'scans' / SCAN / f'{SCAN}{ending}'
    path.unlink() if content is None else path.write_bytes(content)
    with pytest.raises(SceneError, match=message) as caught:
        ScanNetDataset(world).load_truth(0)
    assert path.name in str(caught.value)


def test_a_wrong_count_of_labels_is_named(world):
    path = world / 'scans' / SCAN / f'{SCAN}{LAB}'
    write_ply(path, {'label': NYU[:5]})
    with pytest.raises(SceneError, match='label: 5 labels, the mesh has 8 vertices'):
        ScanNetDataset(world).load_truth(0)
    write_ply(path, {'label': NYU.astype(np.float32) + 0.5})
    with pytest.raises(SceneError, match='label: expected whole numbers'):
        ScanNetDataset(world).load_truth(0)


def test_a_bad_label_map_is_named(world):
    path = world / 'scannetv2-labels.combined.tsv'
    path.write_text('id\traw_category\n1\twall\n')
    with pytest.raises(SceneError, match='no column nyu40id'):
        ScanNetDataset(world).load_truth(0)
    path.write_text('raw_category\tnyu40id\nwall\tone\n')
    with pytest.raises(SceneError, match="line 2, nyu40id: 'one'"):
        ScanNetDataset(world).load_truth(0)
    path.write_text('raw_category\tnyu40id\nwall\t41\n')
    with pytest.raises(SceneError, match='line 2, nyu40id: expected 0 to 40, got 41'):
        ScanNetDataset(world).load_truth(0)


def test_bad_scans_are_left_out_with_one_warning(world):
    (world / 'scannetv2_train.txt').write_text(f'{SCAN}\nscene0001_00\n')
    dataset = ScanNetDataset(world, bad_scenes='skip')
    with pytest.warns(UserWarning, match='1 of 2 scenes cannot be used and are left out: scene0001_00'):
        assert dataset.scene_ids == (SCAN,)


def changed(path, **fields):
    path.write_text(json.dumps(json.loads(path.read_text()) | fields))


@pytest.mark.parametrize('wrong', [[*SEGMENTS[:7], 30.5], [True, *SEGMENTS[1:]], ['5', *SEGMENTS[1:]]])
def test_segments_are_whole_numbers(world, wrong):
    base = world / 'scans' / SCAN
    changed(base / f'{SCAN}_vh_clean_2.0.010000.segs.json', segIndices=wrong)
    with pytest.raises(SceneError, match='segIndices: expected a list of whole numbers, got'):
        ScanNetDataset(world).load_truth(0)


@pytest.mark.parametrize(
    ('segments', 'told'),
    [
        (['5', [9], [2], [7]], r'segGroups\[0\]: expected label and segments'),
        ([[5.9], [9], [2], [7]], r'segGroups\[0\]: expected label and segments'),
        ([[105], [109], [102], [7]], r'3 of its 4 segments are not in .*segs\.json .*102.*are both of one scan'),
    ],
)
def test_objects_name_segments_of_the_scan(world, segments, told):
    groups = [{'label': 'wall', 'segments': part} for part in segments]
    changed(world / 'scans' / SCAN / f'{SCAN}.aggregation.json', segGroups=groups)
    with pytest.raises(SceneError, match=told):
        ScanNetDataset(world).load_truth(0)


@pytest.mark.parametrize(('kind', 'brightest'), [('f4', 1.0), ('u2', 65535)])
def test_colours_of_other_kinds(world, kind, brightest):
    rgb = (RGB / 255 * brightest).astype(kind)
    columns = {a: XYZ[:, i] for i, a in enumerate('xyz')} | {
        c: rgb[:, i] for i, c in enumerate(('red', 'green', 'blue'))
    }
    write_ply(world / 'scans' / SCAN / f'{SCAN}_vh_clean_2.ply', columns)
    np.testing.assert_allclose(ScanNetDataset(world).load_cloud(0).colors, RGB / 255, atol=2e-5)


def test_a_matrix_that_does_not_turn_is_told(world):
    (world / 'scans' / SCAN / f'{SCAN}.txt').write_text('axisAlignment = ' + '0 ' * 16)
    with pytest.raises(SceneError, match='axisAlignment: its first three columns are no rotation'):
        ScanNetDataset(world).load_cloud(0)


def test_lists_and_maps_of_other_programs(world):
    """UTF-16 and marks at the beginning; one name with two ids is told."""
    (world / 'scannetv2_train.txt').write_bytes((SCAN + '\r\n').encode('utf-16'))
    assert ScanNetDataset(world).scene_ids == (SCAN,)
    path = world / 'map.tsv'
    path.write_bytes(TSV.replace('\n', '\r\n').encode('utf-16'))
    assert read_label_map(path) == {'wall': 1, 'chair': 5, 'office chair': 5, 'cushion': 18}
    path.write_text(TSV + '9\tchair\tchair\t7\n')
    with pytest.raises(SceneError, match="map.tsv, line 6, nyu40id: 'chair' is 7, but 5 further above"):
        read_label_map(path)
