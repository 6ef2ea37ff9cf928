"""Scans of every kind in, classes of points out; the networks know nothing and are compared with themselves."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from runs.random_segmentor import NAMES, make_checkpoint, make_scan

from rm3d_plugin.datasets import scannet_format, semantic3d_format, semantickitti_format
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.inference.predict import find_scans, predict_files
from rm3d_plugin.inference.predict_formats import ScanPrediction
from rm3d_plugin.inference.predict_points import PointOptions, fit_channels, keep_labels, trained_intensity_range
from rm3d_plugin.models.heads.proposals import Instances
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.storage.columns import read_columns
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.storage.scans import read_scan
from rm3d_plugin.structures import Boxes3D, PointCloud, PseudoLabels, SceneError


def run(checkpoint, scan, out, **options):
    files = list(predict_files(checkpoint, [scan], out, options=PointOptions(**options)))
    return files[0]


@pytest.fixture(scope='module')
def checkpoint(tmp_path_factory):
    return make_checkpoint(tmp_path_factory.mktemp('net') / 'epoch_1.pth')


def test_ply_las_and_npz_say_the_same_and_keep_utm_coordinates(checkpoint, tmp_path):
    pytest.importorskip('laspy')
    utm = (468_123.0, 5_764_321.0, 80.0)
    scan = make_scan(tmp_path / 'utm.ply', shift=utm)
    source = read_scan(scan).cloud
    read = {
        kind: read_scan(run(checkpoint, scan, tmp_path / 'out', format=kind), labels=True) for kind in ('ply', 'las')
    }
    arrays = np.load(run(checkpoint, scan, tmp_path / 'out', format='npz'))
    assert sorted(np.unique(arrays['label'])) <= [0, 1, 2] and arrays['classes'].tolist() == list(NAMES)
    np.testing.assert_array_equal(arrays['xyz'] + arrays['origin'], source.xyz + source.origin)
    assert (arrays['confidence'] > 1 / 3).all()
    for kind, step in (('ply', 1e-5), ('las', 1.1e-4)):
        np.testing.assert_array_equal(read[kind].label, arrays['label'])
        world = read[kind].cloud.xyz + read[kind].cloud.origin
        np.testing.assert_allclose(world, source.xyz + source.origin, atol=step)
    near = make_scan(tmp_path / 'near.ply')  # the same scan elsewhere is the same to the network, but for rounding
    same = np.load(run(checkpoint, near, tmp_path / 'out', format='npz'))
    assert (same['label'] == arrays['label']).mean() > 0.6


@pytest.mark.parametrize('ending', ['.ply', '.npz', '.npy', '.txt', '.bin', '.las', '.pcd'])
def test_every_kind_of_scan(ending, tmp_path):
    network = make_checkpoint(tmp_path / 'net.pth', columns=())
    rng = np.random.default_rng(0)
    xyz, path = rng.uniform(0, 5, (40, 3)).astype(np.float32), tmp_path / f'scan{ending}'
    if ending == '.ply':
        write_ply(path, {axis: xyz[:, i] for i, axis in enumerate('xyz')})
    elif ending == '.npz':
        np.savez(path, xyz=xyz)
    elif ending == '.npy':
        np.save(path, xyz)
    elif ending == '.txt':
        np.savetxt(path, xyz)
    elif ending == '.bin':
        np.c_[xyz, rng.random(40)].astype('<f4').tofile(path)
    elif ending == '.las':
        laspy = pytest.importorskip('laspy')
        las = laspy.create()
        las.x, las.y, las.z = xyz.T
        las.write(path)
    else:
        head = (
            'VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 40\nHEIGHT 1\nPOINTS 40\nDATA ascii\n'
        )
        path.write_text(head + ''.join(f'{a} {b} {c}\n' for a, b, c in xyz))
    found = read_scan(run(network, path, tmp_path / 'out'), labels=True)
    assert len(found.label) == 40 and set(found.label.tolist()) <= {0, 1, 2}


def test_uncertain_points_are_unknown_and_grey(checkpoint, tmp_path):
    scan = make_scan(tmp_path / 'a.ply')
    all_known = np.load(run(checkpoint, scan, tmp_path / 'out', format='npz'))
    gamma = float(np.median(all_known['confidence']))
    some = np.load(run(checkpoint, scan, tmp_path / 'out', format='npz', unknown_below=gamma))
    expected = np.where(all_known['confidence'] < gamma, -1, all_known['label'])
    np.testing.assert_array_equal(some['label'], expected)
    assert 0.3 < (expected < 0).mean() < 0.7
    ply = read_scan(run(checkpoint, scan, tmp_path / 'out', unknown_below=gamma, paint=True))
    np.testing.assert_allclose(ply.cloud.colors[expected < 0], 0.8, atol=0.01)
    (color,) = np.unique(ply.cloud.colors[expected == expected.max()], axis=0)
    assert np.ptp(color) > 0.1


def test_ply_keeps_what_the_scan_holds(checkpoint, tmp_path):
    columns = read_columns(make_scan(tmp_path / 'plain.ply'))
    columns |= {'scalar_age': np.arange(300, dtype=np.float32), 'label': np.full(300, 7, dtype=np.uint8)}
    scan = write_ply(tmp_path / 'a.ply', columns)
    after = read_columns(run(checkpoint, scan, tmp_path / 'out'))
    for name, values in columns.items():
        kept = after['input_label' if name == 'label' else name]
        np.testing.assert_array_equal(kept, values)
        assert kept.dtype == values.dtype
    assert set(after) - set(columns) == {'confidence', 'input_label'} and after['label'].max() <= 2
    painted = read_columns(run(checkpoint, scan, tmp_path / 'painted', paint=True))
    np.testing.assert_array_equal(painted['input_red'], columns['red'])
    assert len(np.unique(painted['red'])) <= 3


@pytest.mark.parametrize('classify', [False, True])
def test_las_keeps_every_dimension(checkpoint, classify, tmp_path):
    laspy, rng = pytest.importorskip('laspy'), np.random.default_rng(0)
    las = laspy.create(point_format=7, file_version='1.4')
    las.add_extra_dim(laspy.ExtraBytesParams('height', np.float32))
    las.header.offsets, las.header.scales = [4e5, 5e6, 0], [1e-3, 1e-3, 1e-3]
    las.x, las.y, las.z = (rng.uniform(0, 5, (60, 3)) + [4e5, 5e6, 0]).T
    las.classification, las.gps_time = np.full(60, 6, np.uint8), np.arange(60.0)
    las.intensity, las.height = np.arange(60, dtype=np.uint16), np.arange(60, dtype=np.float32)
    las.red = las.green = las.blue = np.full(60, 300, np.uint16)
    las.write(tmp_path / 'a.laz' if classify else tmp_path / 'a.las')
    scan = next(tmp_path.glob('a.la?'))
    after = laspy.read(run(checkpoint, scan, tmp_path / 'out', format='las', classify=classify))
    for name in las.point_format.dimension_names:
        if name != 'classification' or not classify:
            np.testing.assert_array_equal(np.asarray(after[name]), np.asarray(las[name]))
    label = np.asarray(after['label'])
    assert set(label.tolist()) <= {0, 1, 2} and (after.header.offsets == las.header.offsets).all()
    if classify:
        np.testing.assert_array_equal(after.classification, 64 + label)
        assert set(np.asarray(after['input_classification']).tolist()) == {6}
    as_ply = read_columns(run(checkpoint, scan, tmp_path / 'out'))
    assert as_ply['classification'].tolist() == [6] * 60 and as_ply['height'].tolist() == list(range(60))


def test_tables_and_archives_keep_their_columns_in_every_format(tmp_path):
    pytest.importorskip('laspy')
    network = make_checkpoint(tmp_path / 'net.pth', columns=(), named={'x': 'e', 'y': 'n', 'z': 'h'})
    scan = tmp_path / 'a.csv'
    rows = ''.join(f'{i / 7:.3f},{i % 5},{i % 3},{i},0.5\n' for i in range(40))
    scan.write_text('e,n,h,time,intensity\n' + rows)
    for kind in ('ply', 'las', 'npz'):
        after = read_columns(run(network, scan, tmp_path / 'out', format=kind))
        assert after['time'].tolist() == list(range(40)), kind
        assert set(after['input_intensity' if kind == 'las' else 'intensity'].tolist()) == {0.5}
        np.testing.assert_allclose(after['x'], after['e'], atol=2e-4)
    np.savez(tmp_path / 'b.npz', xyz=np.random.default_rng(0).uniform(0, 5, (40, 3)), name='hall', old=np.arange(40))
    network = make_checkpoint(tmp_path / 'net.pth', columns=())
    with np.load(run(network, tmp_path / 'b.npz', tmp_path / 'out', format='npz')) as after:
        assert str(after['name']) == 'hall' and after['old'].tolist() == list(range(40)) and 'label' in after


def test_points_without_a_place_are_left_out_with_all_they_hold(checkpoint, tmp_path):
    columns = read_columns(make_scan(tmp_path / 'plain.ply'))
    columns['x'][3] = np.nan
    scan = write_ply(tmp_path / 'a.ply', columns | {'age': np.arange(300, dtype=np.int32)})
    with pytest.warns(UserWarning, match='1 of 300 points are NaN'):
        after = read_columns(run(checkpoint, scan, tmp_path / 'out', nan_points='drop'))
    assert after['age'].tolist() == [age for age in range(300) if age != 3]


def test_thinned_runs_answer_for_every_original_point(tmp_path):
    network = make_checkpoint(tmp_path / 'net.pth', voxel_downsample=1.0, instances=True)
    scan = make_scan(tmp_path / 'a.ply', count=2000)
    arrays = np.load(run(network, scan, tmp_path / 'out', format='npz'))
    assert len(arrays['label']) == len(arrays['instance']) == 2000
    cells = np.floor(arrays['xyz'] + arrays['origin'].astype(np.float64)).astype(int)
    _, group = np.unique(cells, axis=0, return_inverse=True)
    for name in ('label', 'instance', 'confidence'):
        first = np.zeros(group.max() + 1, dtype=arrays[name].dtype)
        first[group] = arrays[name]
        np.testing.assert_array_equal(first[group], arrays[name])  # a voxel has one answer


def test_points_that_the_pipeline_drops_are_unknown(tmp_path):
    network = make_checkpoint(tmp_path / 'net.pth', pipeline=[dict(type='LimitPoints', max_points=100)])
    arrays = np.load(run(network, make_scan(tmp_path / 'a.ply'), tmp_path / 'out', format='npz'))
    assert (arrays['label'] >= 0).sum() == (arrays['confidence'] > 0).sum() == 100


def test_chunks_and_rotations_reach_the_network(checkpoint, tmp_path):
    scan = make_scan(tmp_path / 'a.ply', count=3000)
    plain, again, chunks, turned = (
        np.load(run(checkpoint, scan, tmp_path / 'out', format='npz', **options))['confidence']
        for options in ({}, {'max_points': 3000}, {'chunk_size': 2.0}, {'tta_rotations': 3})
    )
    np.testing.assert_array_equal(plain, again)
    for other in (chunks, turned):
        assert (other != plain).mean() > 0.5 and np.abs(other - plain).mean() < 0.2


def test_one_point(checkpoint, tmp_path):
    found = read_scan(run(checkpoint, make_scan(tmp_path / 'a.ply', count=1), tmp_path / 'out'), labels=True)
    assert len(found.label) == 1
    empty = write_ply(tmp_path / 'empty.ply', {axis: np.zeros(0, dtype=np.float32) for axis in 'xyz'})
    with pytest.raises(SceneError, match='empty.ply: holds no points'):
        run(checkpoint, empty, tmp_path / 'out')


def test_missing_colour_is_neutral_and_told(checkpoint, tmp_path):
    scan = make_scan(tmp_path / 'bare.ply', color=False)
    with pytest.warns(UserWarning, match='bare.ply: has no colour, which the network was trained with'):
        run(checkpoint, scan, tmp_path / 'out')
    bare = PointCloud(np.zeros((2, 3), dtype=np.float32), intensity=np.array([0.0, 4095.0]))
    with warnings.catch_warnings():
        warnings.simplefilter('error')  # what is not used is not missed
        fitted = fit_channels(bare, ('intensity', 'rgb'), (), (0.0, 4095.0), 'bare')
    assert fitted.colors.tolist() == [[0.5] * 3] * 2 and fitted.intensity.tolist() == [0.0, 1.0]
    assert fit_channels(bare, (), (), None, 'bare').intensity is None
    with pytest.warns(
        UserWarning, match=r'50.0 % of the points lie outside 0 to 1 and are clipped; pass --intensity-range'
    ):
        assert fit_channels(bare, ('intensity',), ('intensity',), (0.0, 1.0), 'bare').intensity.tolist() == [0.0, 1.0]


def test_points_without_a_label_are_named_by_the_nearest_label_or_the_network():
    """Five points a metre apart, the ends are labelled; of the fourth the network has seen nothing."""
    xyz = np.array([[float(x), 0, 0] for x in range(5)])
    semantic, confidence = np.array([2, -1, -1, -1, 0]), np.array([0.9, 0, 0, 0, 1.0], dtype=np.float32)
    nobody, annotated = np.full(5, -1), np.zeros(5, dtype=bool)
    own = PseudoLabels(semantic, nobody, annotated, confidence, Boxes3D.empty(), annotated[:0])
    probs = np.array([[0.8, 0.1, 0.1], [0.2, 0.5, 0.3], [0.6, 0.3, 0.1], [0.0, 0.0, 0.0], [0.1, 0.8, 0.1]])
    by_network, by_nearest = (keep_labels(probs, xyz, own, fill) for fill in ('network', 'nearest'))
    assert by_network[0].tolist() == [2, 1, 0, -1, 0] and by_nearest[0].tolist() == [2, 2, 2, 0, 0]
    np.testing.assert_allclose(by_network[1], [0.9, 0.5, 0.6, 0, 1])
    np.testing.assert_allclose(by_nearest[1], [0.9, 0.3, 0.1, 0, 1])
    bare = PseudoLabels(nobody, nobody, annotated, 0 * confidence, Boxes3D.empty(), annotated[:0])
    assert keep_labels(probs, xyz, bare, 'nearest')[0].tolist() == [0, 1, 0, -1, 1]
    np.testing.assert_array_equal(keep_labels(probs, xyz, own, None)[0], by_nearest[0])
    with pytest.raises(SceneError, match='fill=likeliest: these labels do not tell it'):
        keep_labels(probs, xyz, own, 'likeliest')
    walked = replace(own, likeliest=np.array([1, 0, 1, 1, -1]))
    for fill in (None, 'likeliest'):
        assert keep_labels(probs, xyz, walked, fill)[0].tolist() == [2, 0, 1, 1, 0]
    np.testing.assert_array_equal(keep_labels(probs, xyz, walked, 'nearest')[0], by_nearest[0])


def test_intensity_is_read_as_in_training():
    assert trained_intensity_range({'type': 'rm3d_plugin.Semantic3DDataset'}) == (-2048.0, 2047.0)
    assert trained_intensity_range({'type': 'FilesDataset', 'intensity_range': 255}) == (0.0, 255.0)
    assert trained_intensity_range({'type': 'FilesDataset'}) is None
    assert trained_intensity_range({'type': 'SemanticKittiDataset'}) == (0.0, 1.0)


def test_submissions(tmp_path):
    scan = make_scan(tmp_path / 'scene0707_00_vh_clean_2.ply')
    network = make_checkpoint(tmp_path / 'scannet.pth', classes=scannet_format.CLASSES, instances=True)
    label = np.load(run(network, scan, tmp_path / 'out', format='npz'))['label']
    files = list(predict_files(network, [scan], tmp_path / 'out', options=PointOptions(format='scannet')))
    assert [str(path.relative_to(tmp_path / 'out')) for path in files] == [
        'semantic/scene0707_00.txt',
        'instance/scene0707_00.txt',
    ]
    np.testing.assert_array_equal(np.loadtxt(files[0], dtype=int), np.array(scannet_format.NYU40_IDS)[label])
    rows = [line.split() for line in files[1].read_text().splitlines()]
    assert rows and all(int(kind) in scannet_format.NYU40_IDS and 0 < float(score) <= 1 for _, kind, score in rows)
    assert all(len((tmp_path / 'out' / 'instance' / name).read_text().splitlines()) == 300 for name, _, _ in rows)

    network = make_checkpoint(tmp_path / 'kitti.pth', classes=semantickitti_format.CLASSES)
    folder = tmp_path / 'sequences' / '11' / 'velodyne'
    folder.mkdir(parents=True)
    raw = np.random.default_rng(0).uniform(0, 1, (50, 4)).astype('<f4')
    raw.tofile(folder / '000007.bin')
    with pytest.warns(UserWarning, match='no colour'):
        (path,) = predict_files(network, [folder], tmp_path / 'out', options=PointOptions(format='semantickitti'))
    assert path == tmp_path / 'out' / 'sequences' / '11' / 'predictions' / '000007.label'
    found = semantickitti_format.read_labels(path, 50)
    assert set(found.semantic.tolist()) <= set(semantickitti_format.CLASS_TO_RAW.tolist())
    assert (semantickitti_format.merge_ids(found.semantic, path) >= 0).all() and (found.instance == 0).all()

    network = make_checkpoint(tmp_path / 's3d.pth', classes=semantic3d_format.CLASSES)
    label = np.load(run(network, scan, tmp_path / 'out', format='npz', unknown_below=0.15))['label']
    path = run(network, scan, tmp_path / 'out', format='semantic3d', unknown_below=0.15)
    assert path.suffix == '.labels'
    np.testing.assert_array_equal(np.loadtxt(path, dtype=int), label + 1)


def test_the_best_instance_of_a_point():
    masks = np.array([[True, True, False, False], [False, True, True, True]])
    instances = Instances(masks, np.array([0, 1]), np.array([0.9, 0.5]))
    found = ScanPrediction(np.array([0, 0, 1, -1]), np.ones(4), instances)
    assert found.instance.tolist() == [0, 0, 1, -1]


def test_what_cannot_be_done_is_told_before_anything_is_predicted(checkpoint, tmp_path):
    scan = make_scan(tmp_path / 'a.ply')
    for options, told in (
        ({'format': 'scannet'}, "--format scannet: the network knows the class 'ground'"),
        ({'format': 'obj'}, "--format: expected one of ply, las, npz.*got 'obj'"),
        ({'tta_rotations': 0}, 'tta_rotations: expected a whole number from 1, got 0'),
        ({'chunk_size': -1.0}, 'chunk_size: expected metres > 0'),
    ):
        with pytest.raises(ConfigError, match=told):
            run(checkpoint, scan, tmp_path / 'out', **options)
    assert not (tmp_path / 'out').exists()
    make_scan(tmp_path / 'b' / 'a.ply')
    with pytest.raises(ConfigError, match='would be written to the same file a'):
        list(predict_files(checkpoint, [scan, tmp_path / 'b'], tmp_path / 'out'))
    with pytest.raises(ConfigError, match='no .bin file in'):
        find_scans([tmp_path / 'b'], ['.bin'])
    (tmp_path / 'b' / '._a.ply').write_bytes(b'\0\5')
    assert find_scans([tmp_path / 'b'], ['.ply']) == [tmp_path / 'b' / 'a.ply']
    (tmp_path / 'a.obj').touch()
    (tmp_path / 'full' / 'a.ply').mkdir(parents=True)
    for wrong, told in (
        ([scan, tmp_path / 'b.ply'], 'b.ply: no such file'),
        ([scan, tmp_path / 'a.obj'], "a.obj: unknown ending '.obj'"),
    ):
        with pytest.raises(ConfigError, match=told):
            list(predict_files(checkpoint, wrong, tmp_path / 'out'))
    with pytest.raises(ConfigError, match='full.a.ply is a folder, where a file is to be written'):
        run(checkpoint, scan, tmp_path / 'full')
    with pytest.raises(SceneError, match='columns: expected x y z'):
        run(checkpoint, scan, tmp_path / 'out', columns='x y')
    assert not (tmp_path / 'out').exists()


def test_labels_of_the_run_stay_where_there_are_some(checkpoint, tmp_path):
    scan, store = make_scan(tmp_path / 'mine.ply', count=30), LabelStore(tmp_path / 'labels')
    said = np.load(run(checkpoint, scan, tmp_path / 'out', format='npz'))
    semantic = np.where(np.arange(30) < 5, (said['label'] + 1) % 3, -1)
    confidence = np.where(semantic >= 0, 0.9, 0).astype(np.float32)
    none, sure = np.full(30, -1), np.zeros(30, dtype=bool)
    store.begin_round(0)
    store.write(0, 'mine', PseudoLabels(semantic, none, sure, confidence, Boxes3D.empty(), sure[:0]))
    store.finish_round(0)
    store.set_current(0)
    kept = np.load(run(checkpoint, scan, tmp_path / 'kept', format='npz', labels=store.root, fill='network'))
    np.testing.assert_array_equal(kept['label'], np.where(semantic >= 0, semantic, said['label']))
    np.testing.assert_allclose(kept['confidence'], np.where(semantic >= 0, 0.9, said['confidence']))
    filled = np.load(run(checkpoint, scan, tmp_path / 'filled', format='npz', labels=store.root))
    near = np.square(said['xyz'][:, None] - said['xyz'][:5]).sum(axis=2).argmin(axis=1)
    np.testing.assert_array_equal(filled['label'], semantic[near])
    agrees = semantic[near] == said['label']
    np.testing.assert_allclose(filled['confidence'][5:][agrees[5:]], said['confidence'][5:][agrees[5:]])
    assert (filled['confidence'][5:][~agrees[5:]] < said['confidence'][5:][~agrees[5:]]).all()
    with pytest.raises(ConfigError, match='fill: is for points without a label'):
        run(checkpoint, scan, tmp_path / 'out', fill='nearest')
    other = make_scan(tmp_path / 'other.ply', count=30)
    with pytest.warns(UserWarning, match='has no labels of this scan'):
        run(checkpoint, other, tmp_path / 'out', labels=store.root)
    with pytest.raises(SceneError, match='labels for 30 points, but the scan has 29'):
        run(checkpoint, make_scan(tmp_path / 'new' / 'mine.ply', count=29), tmp_path / 'out', labels=store.root)


def test_columns_in_large_letters_are_kept_once(checkpoint, tmp_path):
    """A table of another program: colours under R, G and B are colours, and places are written once."""
    (tmp_path / 'a.csv').write_text('X;Y;Z;R;G;B\n1,5;2;3;10;20;30\n2,5;2;4;40;50;60\n')
    path = run(checkpoint, tmp_path / 'a.csv', tmp_path / 'out')
    columns = read_columns(path)
    assert list(columns) == ['x', 'y', 'z', 'R', 'G', 'B', 'label', 'confidence']
    assert columns['x'].tolist() == [1.5, 2.5] and columns['B'].tolist() == [30, 60]
    np.testing.assert_allclose(read_scan(path).cloud.colors, np.array([[10, 20, 30], [40, 50, 60]]) / 255, atol=1e-6)
