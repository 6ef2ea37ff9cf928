"""Labels that come in from fields of files."""

import numpy as np
import pytest
from reference.corner_scan import corner

from rm3d_plugin.annotation import Session
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.storage import DamagedFileError, read_json
from rm3d_plugin.storage.ply import read_ply, write_ply
from rm3d_plugin.structures import SceneError


def columns_of(**fields):
    xyz, _ = corner((4e5, 5e6, 100.0))
    return {axis: xyz[:, i] for i, axis in enumerate('xyz')} | fields


def test_saved_labels_come_back_by_the_names_of_their_classes(tmp_path):
    path = write_ply(tmp_path / 'corner.ply', columns_of())
    with Session([path], classes=['floor', 'wall']) as session:
        session.click('corner', 10, 'floor')
        session.click('corner', 1700, 'wall')
        (saved,) = session.save(tmp_path / 'out')
    summary, labels = read_json(tmp_path / 'out' / 'labels.json'), read_ply(saved)['label']
    assert summary['classes'] == [{'label': 0, 'name': 'floor'}, {'label': 1, 'name': 'wall'}]
    assert summary['scans']['corner']['clicks'] == {'floor': 1, 'wall': 1}
    with Session([path], tmp_path / 'again.jsonl', classes=['wall']) as again:
        assert again.import_labels('corner', saved) == 1800
        assert again.classes == ('wall', 'floor')
        np.testing.assert_array_equal(again.scan('corner').annotated, 1 - labels)
        assert again.undo() and (again.scan('corner').annotated == -1).all()


def test_a_field_of_the_scan_itself_names_classes_by_its_numbers(tmp_path):
    tree = np.full(1800, np.nan, np.float32)
    tree[[3, 5]], tree[8] = 7.0, 2.0
    path = write_ply(tmp_path / 'corner.ply', columns_of(scalar_tree=tree))
    with Session([path]) as session:
        assert session.import_labels('corner', path, 'tree') == 3
        assert session.classes == ('2', '7')
        assert session.scan('corner').annotated[[3, 5, 8, 9]].tolist() == [1, 1, 0, -1]


def test_a_las_classification_of_0_or_1_is_no_label(tmp_path):
    laspy = pytest.importorskip('laspy')
    xyz, _ = corner((4e5, 5e6, 100.0))
    tile = laspy.create(point_format=3)
    tile.header.offsets, tile.header.scales = xyz.min(axis=0), [0.001] * 3
    tile.x, tile.y, tile.z = xyz.T
    tile.classification = np.arange(1800) % 4
    tile.write(tmp_path / 'tile.las')
    with Session([tmp_path / 'tile.las']) as session:
        assert session.import_labels('tile', tmp_path / 'tile.las', 'classification') == 900
        assert session.classes == ('2', '3') and session.scan('tile').annotated[:4].tolist() == [-1, -1, 0, 1]


def test_what_cannot_be_imported_is_told_and_changes_nothing(tmp_path):
    path = write_ply(tmp_path / 'corner.ply', columns_of(label=np.full(1800, -1, np.int32)))
    short = write_ply(
        tmp_path / 'short.ply', {name: values[:9] for name, values in columns_of(label=np.ones(1800)).items()}
    )
    with Session([path]) as session:
        before = session.log.path.read_bytes()
        for file, field, error, words in [
            (path, 'label', ConfigError, "field 'label' labels no point"),
            (path, 'tree', ConfigError, "no field 'tree', got x y z label"),
            (short, 'label', SceneError, 'expected the 1800 points of scan corner, got 9'),
        ]:
            with pytest.raises(error, match=words):
                session.import_labels('corner', file, field)
        (tmp_path / 'times').mkdir()
        times = write_ply(tmp_path / 'times' / 'corner.ply', columns_of(gps=np.arange(1800, dtype=np.int32)))
        with pytest.raises(ConfigError, match="'gps' would make 1800 classes; expected 1000 in all at most"):
            session.import_labels('corner', times, 'gps')
        (tmp_path / 'times' / 'labels.json').write_text('{"classes": ["floor", "wall"]}')
        with pytest.raises(DamagedFileError, match=r'labels\.json: is not the names of labels'):
            session.import_labels('corner', times, 'gps')
        assert session.log.path.read_bytes() == before
