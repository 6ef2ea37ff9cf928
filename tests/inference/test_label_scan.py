import json
import os

import numpy as np
import pytest
from reference.corner_scan import FLOOR, WALL, corner, few, write_clicks_csv

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.inference.given_labels import clicked_labels, field_labels
from rm3d_plugin.inference.label_files import LabelledFiles, LabelOptions, Summary, check_outputs
from rm3d_plugin.inference.label_files import label_files as write_labels
from rm3d_plugin.inference.label_scan import drawn_points, label_scan, nearest_drawn
from rm3d_plugin.label_budgets import BudgetError
from rm3d_plugin.storage.ply import read_ply, write_ply
from rm3d_plugin.structures import PointCloud, SceneError


def annotated_with(points, semantic):
    out = np.full(len(semantic), -1, dtype=np.int64)
    out[points] = semantic[points]
    return out


def label_files(scans, given, out, options=None):
    """Label scans into a folder, one by one."""
    files = LabelledFiles(scans, given, options or LabelOptions())
    return write_labels(files, out, Summary(out, given))


@pytest.fixture
def scan(tmp_path):
    """A PLY file in world coordinates with an intensity, and the classes of its points."""
    xyz, semantic = corner((4e5, 5e6, 100.0))
    columns = {axis: xyz[:, i] for i, axis in enumerate('xyz')}
    columns['intensity'] = np.arange(len(xyz), dtype=np.uint16)
    return write_ply(tmp_path / 'corner.ply', columns), semantic


def test_every_point_gets_the_class_of_its_surface():
    xyz, semantic = corner()
    points = few(semantic, 12)
    found = label_scan(PointCloud(xyz), annotated_with(points, semantic), 3)
    assert (found.semantic == semantic).mean() > 0.97
    assert found.clicks.tolist() == [12, 12, 0]
    np.testing.assert_array_equal(found.confidence[points], 1.0)
    assert found.estimate is not None and found.estimate.low <= 97.0
    assert (
        found.remark().startswith('about ') and 'from 24 of your clicks; method: walker and features' in found.remark()
    )


def test_the_remark_says_why_there_is_no_estimate():
    xyz, semantic = corner()
    cloud = PointCloud(xyz)
    one = label_scan(cloud, annotated_with(few(semantic, 1), semantic), 2)
    assert one.remark() == (
        'no estimate: 2 labelled points are in too few places to leave some of each class out; '
        'method: walker and features (the default)'
    )
    assert (one.semantic == semantic).mean() > 0.9
    unchecked = label_scan(cloud, annotated_with(few(semantic, 12), semantic), 2, check=False)
    assert 'clicks were not checked' in unchecked.remark()
    assert label_scan(cloud, semantic, 2).remark() == 'no estimate: every point was labelled'


def test_a_written_scan_keeps_fields_and_coordinates(scan, tmp_path):
    path, semantic = scan
    points = few(semantic, 12)
    given = clicked_labels(write_clicks_csv(tmp_path / 'clicks.csv', 'corner', points, semantic), [path])
    (written,) = label_files([path], given, tmp_path / 'out')
    assert written.files == [tmp_path / 'out' / 'corner.ply']
    before, after = read_ply(path), read_ply(written.files[0])
    assert list(after) == ['x', 'y', 'z', 'intensity', 'label', 'confidence', 'region']
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values)
        assert after[name].dtype == values.dtype
    np.testing.assert_array_equal(after['label'], written.labelled.semantic)
    np.testing.assert_array_equal(after['label'][points], semantic[points])
    np.testing.assert_array_equal(after['confidence'], written.labelled.confidence)
    told = json.loads((tmp_path / 'out' / 'labels.json').read_text())
    assert told['classes'] == [{'label': 0, 'name': 'floor'}, {'label': 1, 'name': 'wall'}]
    (summary,) = told['scans'].values()
    assert summary['clicks'] == {'floor': 12, 'wall': 12}
    assert sum(summary['points'].values()) == len(semantic)
    assert summary['estimate']['clicks'] == 24
    assert sorted(item.name for item in (tmp_path / 'out').iterdir()) == ['corner.ply', 'labels.json']


def test_labels_in_a_field_keep_their_numbers_and_the_field(tmp_path):
    xyz, semantic = corner()
    field = np.full(len(xyz), np.nan, dtype=np.float32)
    points = few(semantic, 3)
    field[points] = np.array([6, 2])[semantic[points]]
    columns = {axis: xyz[:, i].astype(np.float32) for i, axis in enumerate('xyz')}
    path = write_ply(tmp_path / 'corner.ply', {**columns, 'scalar_Label': field})
    given = field_labels('label', [path])
    assert (given.names, given.values) == (('2', '6'), (2, 6))
    (written,) = label_files([path], given, tmp_path / 'out', LabelOptions(check=False))
    after = read_ply(written.files[0])
    np.testing.assert_array_equal(after['input_scalar_Label'], field)
    assert (after['label'] == np.array([6, 2])[semantic]).mean() > 0.9
    np.testing.assert_array_equal(after['label'][points], field[points])


def test_values_that_mean_unlabelled(tmp_path):
    columns = {axis: np.arange(6, dtype=np.float32) for axis in 'xyz'}
    path = write_ply(tmp_path / 'a.ply', {**columns, 'class': np.array([0, 0, 3, 4, 255, 3], np.uint8)})
    given = field_labels('class', [path], unlabelled=[0, 255])
    assert given.values == (3, 4)
    assert given.scans['a'].on_points(6).tolist() == [-1, -1, 0, 1, -1, 0]


def test_classification_of_las_knows_two_values_that_mean_unlabelled(tmp_path):
    laspy = pytest.importorskip('laspy')
    xyz, semantic = corner((4e5, 5e6, 100.0))
    las = laspy.create(point_format=3, file_version='1.4')
    las.header.offsets, las.header.scales = xyz.min(axis=0), [1e-3] * 3
    las.x, las.y, las.z = xyz.T
    given = np.where(np.arange(len(xyz)) % 2, 1, 0)
    points = few(semantic, 3)
    given[points] = np.array([2, 6])[semantic[points]]
    las.classification = given.astype(np.uint8)
    las.gps_time = np.arange(len(xyz), dtype=np.float64)
    las.add_extra_dim(laspy.ExtraBytesParams('label', np.int32))
    las['label'] = np.full(len(xyz), 7)
    path = tmp_path / 'corner.las'
    las.write(path)
    labels = field_labels('classification', [path])
    assert labels.values == (2, 6)
    (written,) = label_files([path], labels, tmp_path / 'out', LabelOptions(check=False))
    after = laspy.read(written.files[0])
    np.testing.assert_array_equal(np.asarray(after.classification), given)
    np.testing.assert_array_equal(np.asarray(after.gps_time), las.gps_time)
    np.testing.assert_allclose(np.asarray(after.x), xyz[:, 0], atol=1e-3)
    np.testing.assert_array_equal(after['input_label'], 7)
    assert (np.asarray(after['label']) == np.array([2, 6])[semantic]).mean() > 0.9


@pytest.mark.parametrize(
    ('lines', 'message'),
    [
        (['corner,0,floor', 'hall,1,wall'], "clicks.csv line 3: scene 'hall' is none of the scans: corner"),
        (['corner,0,floor', 'corner,1,floor'], 'labels points of 1 class of corner.ply; expected at least two'),
        (
            [f'corner,{i},c{i}' for i in range(1001)],
            '1001 classes; expected at most 1000: are these numbers of points?',
        ),
        (['corner,0,floor', 'corner,1800,wall'], 'has the points 0..1799, got index 1800'),
        (['corner,0,floor', 'corner,0,wall'], 'has another label'),
    ],
)
def test_clicks_that_cannot_be_used(scan, tmp_path, lines, message):
    clicks = tmp_path / 'clicks.csv'
    clicks.write_text('\n'.join(['scene,index,class', *lines]))
    with pytest.raises((ConfigError, BudgetError), match=message.replace('(', r'\(')):
        clicked_labels(clicks, [scan[0]])


def test_a_click_beside_the_scan_is_an_error(scan, tmp_path):
    clicks = tmp_path / 'clicks.csv'
    clicks.write_text('scene,x,y,z,class\ncorner,400000,5000000,100,floor\ncorner,400000,5000000,900,wall\n')
    with pytest.raises(BudgetError, match='line 3: the nearest point of scene corner is .* m from the clicked place'):
        clicked_labels(clicks, [scan[0]])


def test_fields_that_cannot_be_used(tmp_path):
    columns = {axis: np.arange(4, dtype=np.float32) for axis in 'xyz'}
    path = write_ply(tmp_path / 'a.ply', {**columns, 'half': np.array([0.5, 1, 2, 3], np.float32)})
    with pytest.raises(ConfigError, match="no field 'label', got x y z half"):
        field_labels('label', [path])
    with pytest.raises(SceneError, match='half: expected whole numbers, got 0.5'):
        field_labels('half', [path])


def test_nothing_is_written_over_an_input(scan, tmp_path):
    path, _ = scan
    with pytest.raises(ConfigError, match='would be written over the input'):
        check_outputs([path], [], tmp_path, LabelOptions())
    (tmp_path / 'links').mkdir()
    os.link(path, tmp_path / 'links' / 'corner.ply')
    with pytest.raises(ConfigError, match='would be written over the input'):
        check_outputs([path], [], tmp_path / 'links', LabelOptions())
    (tmp_path / 'alias').symlink_to(tmp_path)
    with pytest.raises(ConfigError, match='would be written over the input'):
        check_outputs([path], [], tmp_path / 'alias', LabelOptions())
    with pytest.raises(ConfigError, match='would be written over the input'):
        check_outputs([path], [tmp_path / 'out' / 'labels.json'], tmp_path / 'out', LabelOptions())
    with pytest.raises(ConfigError, match='same file'):
        check_outputs([path, tmp_path / 'other' / 'corner.las'], [], tmp_path / 'out', LabelOptions())
    check_outputs([path], [], tmp_path / 'out', LabelOptions())


def test_the_classes_in_other_formats(scan, tmp_path):
    path, semantic = scan
    names = ('road', 'building')
    clicks = write_clicks_csv(tmp_path / 'clicks.csv', 'corner', few(semantic, 3), semantic, names)
    given = clicked_labels(clicks, [path])
    options = LabelOptions(format='semantickitti', check=False)
    (written,) = label_files([path], given, tmp_path / 'out', options)
    raw = np.fromfile(written.files[0], dtype='<u4')
    assert written.files[0].name == 'corner.label'
    assert (raw == np.array([40, 50])[semantic]).mean() > 0.9
    assert {FLOOR, WALL} == set(np.unique(semantic))


@pytest.fixture
def two_scans(tmp_path):
    """The corner twice, the second elsewhere; clicks on both classes of the first."""
    paths = []
    for name, origin in (('first', (0.0, 0.0, 0.0)), ('second', (50.0, 0.0, 0.0))):
        xyz, semantic = corner(origin)
        paths.append(write_ply(tmp_path / f'{name}.ply', {axis: xyz[:, i] for i, axis in enumerate('xyz')}))
    clicks = write_clicks_csv(tmp_path / 'clicks.csv', 'first', few(semantic, 12), semantic)
    return paths, clicks, semantic


@pytest.mark.parametrize('clicked', [[], ['second,0,floor']])
def test_a_class_that_is_clicked_in_one_scan_is_found_in_another(two_scans, tmp_path, clicked):
    paths, clicks, semantic = two_scans
    clicks.write_text(clicks.read_text() + '\n'.join(clicked))
    first, second = label_files(paths, clicked_labels(clicks, paths), tmp_path / 'out')
    assert (first.labelled.semantic == semantic).mean() > 0.97
    assert (second.labelled.semantic == semantic).mean() > 0.9
    assert second.labelled.clicks.tolist() == [len(clicked), 0]
    assert second.labelled.remark().startswith(
        'no estimate: ' + ('1 labelled point is' if clicked else 'no click is in this scan')
    )


def test_a_scan_that_nothing_teaches_is_told_before_anything_is_written(two_scans, tmp_path):
    paths, clicks, _ = two_scans
    strange = read_ply(paths[1])
    write_ply(paths[1], {**strange, 'intensity': np.arange(len(strange['x']), dtype=np.float32)})
    with pytest.raises(ConfigError, match='second.ply: has no label, and no other scan with the same channels'):
        list(label_files(paths, clicked_labels(clicks, paths), tmp_path / 'out'))
    assert not (tmp_path / 'out').exists()


def test_a_failure_leaves_the_summary_of_the_finished_scans(two_scans, tmp_path, monkeypatch):
    paths, clicks, _ = two_scans
    rows = clicks.read_text() + clicks.read_text().partition('\n')[2].replace('first', 'second')
    clicks.write_text(rows)
    scans = label_files(paths, clicked_labels(clicks, paths), tmp_path / 'out', LabelOptions(check=False))
    next(scans)
    assert list(json.loads((tmp_path / 'out' / 'labels.json').read_text())['scans']) == ['first']

    def full_disk(*_):
        raise OSError('no space left')

    monkeypatch.setattr('rm3d_plugin.inference.label_files.write_labelled', full_disk)
    with pytest.raises(OSError, match='no space'):
        next(scans)
    told = json.loads((tmp_path / 'out' / 'labels.json').read_text())
    assert list(told['scans']) == ['first'] and told['scans']['first']['kind'] == 'rooms'
    assert [item['name'] for item in told['classes']] == ['floor', 'wall']


def test_regions_partition_the_scan_and_hardly_cross_the_edge():
    xyz, semantic = corner()
    found = label_scan(PointCloud(xyz), annotated_with(few(semantic, 3), semantic), 2, check=False)
    region = found.region
    counts = np.bincount(region)
    assert 10 <= len(counts) <= len(xyz) // 50 and counts.min() >= 1
    _, first = np.unique(region, return_index=True)
    assert (np.diff(first) > 0).all()  # numbered by their first point
    walls = np.bincount(region, semantic == WALL)
    assert (
        np.maximum(walls, counts - walls).sum() / len(xyz) > 0.95
    )  # regions of 50 points at the edge hold some of both


def test_a_large_scan_follows_the_points_that_were_drawn(monkeypatch):
    xyz, semantic = corner()
    annotated = annotated_with(few(semantic, 6), semantic)
    monkeypatch.setattr(label_scan.__module__ + '.MOST_POINTS', len(xyz) // 3)
    found = label_scan(PointCloud(xyz), annotated, 2)
    assert len(found.semantic) == len(found.region) == len(xyz)
    assert (found.semantic == semantic).mean() > 0.95
    assert (found.confidence[annotated >= 0] == 1.0).all()
    drawn = drawn_points(len(xyz), np.flatnonzero(annotated >= 0), len(xyz) // 3)
    apart = np.square(xyz[:, None] - xyz[drawn]).sum(axis=2).argmin(axis=1)
    np.testing.assert_array_equal(nearest_drawn(PointCloud(xyz), drawn)[drawn], np.arange(len(drawn)))
    assert (nearest_drawn(PointCloud(xyz), drawn) == apart).mean() > 0.99  # ties
