"""Objects of a session: their points, their boxes, undo, other programs' files."""

import numpy as np
import pytest

from rm3d_plugin.annotation import ClickFileError, ClickLog, Session
from rm3d_plugin.annotation.box_exchange import export_boxes, import_boxes
from rm3d_plugin.annotation.object_fit import fit_object_box
from rm3d_plugin.datasets import BoxFilesDataset
from rm3d_plugin.datasets.box_formats import BOX_FORMATS
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.pseudo_labels.detection.boxes import tight_box
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.structures import SceneError

ORIGIN = np.array([4e5, 5e6, 100.0])
SIZE, YAW = np.array([4.0, 1.8, 1.5]), 0.4
MIDDLES = np.array([[5.0, 5.0, 0.8], [10.5, 5.5, 0.8]])  # of two cars, 3 cm above the ground


def car(rng, middle, count=900):
    """Points on the sides and the roof of a box."""
    unit = rng.uniform(-0.5, 0.5, (count, 3))
    face = rng.integers(5, size=count)
    unit[face < 4, face[face < 4] // 2] = face[face < 4] % 2 - 0.5
    unit[face == 4, 2] = 0.5
    c, s = np.cos(YAW), np.sin(YAW)
    return unit * SIZE @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) + middle


@pytest.fixture(scope='module')
def street(tmp_path_factory):
    """A road with two cars in world coordinates; 0 = road, 1 and 2 = the cars."""
    rng = np.random.default_rng(0)
    road = np.c_[rng.uniform(0, 14, (3000, 2)), rng.normal(0, 0.005, 3000)]
    cars = [car(rng, middle) for middle in MIDDLES]
    xyz = np.concatenate([road, *cars]) + ORIGIN
    path = write_ply(tmp_path_factory.mktemp('street') / 'street.ply', {a: xyz[:, i] for i, a in enumerate('xyz')})
    return path, np.repeat([0, 1, 2], [3000, 900, 900])


@pytest.fixture
def session(street, tmp_path):
    path, part = street
    with Session([path], tmp_path / 's.jsonl', ['road', 'car']) as opened:
        opened.brush('street', np.flatnonzero(part == 0)[::600], 'road')
        for number in (1, 2):
            opened.brush('street', np.flatnonzero(part == number)[50::90], 'car', instance=number - 1)
        yield opened


def expected(number):
    return np.r_[MIDDLES[number] + ORIGIN, SIZE, YAW]


def test_a_box_is_fitted_to_each_of_two_cars(street, session):
    part = street[1]
    for number in (0, 1):
        own = session.objects.points('street', number)
        truth = np.flatnonzero(part == number + 1)
        assert len(np.intersect1d(own, truth)) / len(np.union1d(own, truth)) > 0.6
        row = session.objects.fit('street', number).row
        np.testing.assert_allclose(row[:6], expected(number)[:6], atol=0.25)
        assert abs(np.rad2deg(row[6] - YAW)) < 5
    listed = session.objects.listed('street')
    assert [(each.semantic, each.clicked) for each in listed.values()] == [(1, 10), (1, 10)]
    assert session.objects.next_number('street') == 2


def test_less_seen_is_made_as_large_as_the_class_usually_is(street, session):
    session.objects.set_box('street', 5, expected(0), 'car')
    shape = session.objects.usual_size(1)
    np.testing.assert_allclose(shape, SIZE)
    points = car(np.random.default_rng(1), np.zeros(3))
    seen = points[points[:, :2] @ (np.cos(YAW), np.sin(YAW)) < -1.0]  # the rear alone
    box = fit_object_box(seen, shape, sensor=(-20 * np.cos(YAW), -20 * np.sin(YAW)))
    np.testing.assert_allclose(box[3:6], SIZE, atol=0.15)
    np.testing.assert_allclose(box[:2], 0, atol=0.15)
    assert fit_object_box(seen)[3] < 2.0 and len(fit_object_box(np.zeros((1, 3)))) == 7


def test_points_that_lie_on_all_sides_need_no_sensor():
    box = tight_box(car(np.random.default_rng(2), np.array([100.0, 50.0, 0.0])), sensor=None)
    np.testing.assert_allclose(box, np.r_[100, 50, 0, SIZE, YAW], atol=0.05)


def test_boxes_are_actions_of_the_log(street, session):
    objects, log = session.objects, session.log.path
    fitted = objects.fit('street', 0)
    moved = objects.set_box('street', 0, np.add(fitted.row, [1.0, 0, 0, 0.5, 0, 0, 0.1]))
    assert objects.boxes('street') == {0: moved}
    assert session.undo() and objects.boxes('street') == {0: fitted}
    assert session.redo() and ClickLog(log).boxes('street') == {0: moved}
    objects.remove_box('street', 0)
    assert objects.boxes('street') == ClickLog(log).boxes('street') == {}
    assert session.undo() and objects.boxes('street') == {0: moved}
    session.rename_class('car', 'auto')
    assert objects.named('street').names == ['auto'] and ClickLog(log).boxes('street') == {0: moved}
    assert ClickLog(log).clicks == session.log.clicks  # boxes are no clicks


def test_what_is_no_object_is_told(street, session):
    objects = session.objects
    before = session.log.path.read_bytes()
    for action, error, words in [
        (lambda: objects.fit('street', 7), SceneError, 'there is no object 7: give it a point first'),
        (lambda: objects.remove_box('street', 0), SceneError, 'object 0 has no box'),
        (lambda: objects.set_box('street', 0, np.zeros(7)), ClickFileError, 'size: expected lengths above 0 m'),
        (lambda: objects.set_box('street', 0, np.full(7, np.nan)), ClickFileError, 'seven finite numbers'),
        (lambda: objects.set_box('street', 0, expected(0), 'bus'), ClickFileError, "no class 'bus'"),
        (lambda: export_boxes(session, session.log.path.parent / 'out'), SceneError, 'no object has a box yet'),
        (lambda: export_boxes(session, session.log.path.parent / 'out', 'x'), ConfigError, 'expected one of openpcdet'),
    ]:
        with pytest.raises(error, match=words):
            action()
    assert session.log.path.read_bytes() == before
    session.click('street', 3500, 'road', instance=9)
    session.undo()
    with Session([street[0]], session.log.path.with_name('one.jsonl'), ['car']) as alone:
        alone.click('street', 3500, 'car', instance=0)
        with pytest.raises(SceneError, match='label what is around it with another class first'):
            alone.objects.fit('street', 0)


@pytest.mark.parametrize('kind', list(BOX_FORMATS))
def test_boxes_go_out_and_come_back(street, session, tmp_path, kind):
    for number in (0, 1):
        session.objects.set_box('street', number, expected(number))
    (written,) = export_boxes(session, tmp_path / 'out', kind)
    with Session([street[0]], tmp_path / 'other.jsonl') as other:
        assert import_boxes(other.objects, 'street', [written], kind) == [0, 1]
        found = other.objects.named('street')
        assert [name.lower() for name in found.names] == ['car', 'car']  # KITTI spells it Car
        np.testing.assert_allclose(found.tensor, [expected(0), expected(1)], atol=2e-3)
        assert other.undo() and other.objects.boxes('street') == {}


def test_a_data_set_of_boxes_reads_what_was_exported(session, tmp_path):
    session.objects.set_box('street', 1, expected(1))
    export_boxes(session, tmp_path / 'out')
    data = BoxFilesDataset(tmp_path / 'out', cache=None)
    assert data.scene_ids == ('street',) and data.classes == ('car',)
    cloud, truth = data.load_cloud(0), data.load_truth(0)
    np.testing.assert_allclose(truth.boxes.tensor[0, :3] + cloud.origin, expected(1)[:3], atol=1e-4)
    assert (truth.instance == 0).sum() > 500
    assert BoxFilesDataset(tmp_path / 'out', split='val', cache=None).scene_ids == ('street',)
