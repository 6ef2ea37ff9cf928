"""The page: what a click does, without a browser."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from reference.corner_scan import corner, few

from rm3d_plugin.annotation import Session, read_clicks
from rm3d_plugin.storage.ply import read_ply, write_ply

pytest.importorskip('viser', reason='the page needs rm3d_plugin[annotate]')
from rm3d_plugin.annotation.page import AnnotationPage, Outputs  # noqa: E402
from rm3d_plugin.pseudo_labels.propagation.given_up import GivenUpError  # noqa: E402


class Camera(SimpleNamespace):
    """As viser's: what is looked at moves with the position."""

    @property
    def position(self):
        return self._position

    @position.setter
    def position(self, place):
        self.look_at = self.look_at + (np.asarray(place) - self._position)
        self._position = np.asarray(place)


class Client:
    """A browser that keeps what it is told."""

    def __init__(self):
        self.told = []
        down = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about x: the picture's right is x, its down is -y
        self.camera = Camera(
            _position=np.array([1.5, 1.5, 20.0]), look_at=np.array([1.5, 1.5, 0.0]), wxyz=down, fov=0.3, aspect=1.0
        )

    def add_notification(self, title, text, **options):
        self.told.append(text)


@pytest.fixture
def opened(tmp_path):
    """A page on a floor and a wall, and the classes of the points."""
    xyz, semantic = corner((4e5, 5e6, 100.0))
    path = write_ply(tmp_path / 'corner.ply', {axis: xyz[:, i] for i, axis in enumerate('xyz')})
    with Session([path], classes=['floor', 'wall']) as session:
        page = AnnotationPage(session, Outputs(tmp_path / 'out'), port=18080)
        yield page, semantic
        page.stop()


def at(page, point, client=None):
    """A click that is aimed at a point."""
    place = page.session.scan('corner').cloud.xyz[point]
    eye = place + np.array([-2.0, -2.0, 2.0])
    return SimpleNamespace(client=client or Client(), ray_origin=tuple(eye), ray_direction=tuple(place - eye))


def test_a_click_labels_the_point_under_it_and_the_picture_follows(opened):
    page, semantic = opened
    points, click = few(semantic, 1), page.guarded(page._clicked)
    for number, name in enumerate(page.session.classes):
        page._class.value = name
        click(at(page, points[number]))
    labelled = np.flatnonzero(page.session.scan('corner').annotated >= 0)
    xyz = page.session.scan('corner').cloud.xyz
    near = np.linalg.norm(xyz[labelled][:, None] - xyz[points], axis=2).min(axis=0)
    assert len(labelled) == 2 and near.max() < 0.3
    assert page.view.by.value == 'class' and (page.labels.semantic == semantic).mean() > 0.85
    assert 'every click is kept' in page._status.content
    page._undo(Client())
    assert (page.session.scan('corner').annotated >= 0).sum() == 1


def test_fewer_points_can_be_shown_and_labels_are_on_all(opened, monkeypatch):
    page, semantic = opened
    assert len(page.picture.shown) == 1800
    monkeypatch.setattr(page.view, 'most', SimpleNamespace(value=0.5))
    page.view.draw()
    assert page.picture.shown.tolist() == list(range(0, 1800, 4))
    page.guarded(page._clicked)(at(page, 4))
    assert len(page.labels.semantic) == 1800 and (page.labels.semantic >= 0).all()


def test_a_stroke_is_marked_by_few_dots_and_clicks_of_two_classes_by_one_each(opened):
    page, _ = opened
    page.session.brush('corner', range(900), 'floor')
    page.session.click('corner', 450, 'wall')
    page.changed()
    assert 2 <= len(page.picture.dots.points) <= 10
    xyz = page.session.scan('corner').cloud.xyz
    assert np.abs(page.picture.dots.points - xyz[450]).max(axis=1).min() < 1e-6


def test_what_cannot_be_is_said_on_the_page(opened):
    page, semantic = opened
    client = Client()
    away = SimpleNamespace(client=client, ray_origin=(0.0, 0.0, 50.0), ray_direction=(0.0, 0.0, 1.0))
    page.guarded(page._clicked)(away)
    page.guarded(lambda event: page._save(event.client))(SimpleNamespace(client=client))
    page.guarded(lambda event: page._undo(event.client))(SimpleNamespace(client=client))
    assert client.told[0] == 'no point there: click on a point of the scan'
    assert client.told[1] == 'nothing to save: no point is labelled yet'
    assert client.told[2] == 'nothing to undo'


def test_a_scan_that_cannot_be_read_is_said_and_the_one_before_stays(tmp_path):
    xyz, _ = corner()
    columns = {axis: xyz[:, i] for i, axis in enumerate('xyz')}
    scans = [write_ply(tmp_path / 'corner.ply', columns)]
    scans.append(write_ply(tmp_path / 'empty.ply', {axis: values[:0] for axis, values in columns.items()}))
    with Session(scans, classes=['floor']) as session:
        page, client = AnnotationPage(session, Outputs(tmp_path / 'out'), port=18080), Client()
        page._scan.value = 'empty'
        page.guarded(lambda event: page._switch('empty'))(SimpleNamespace(client=client))
        assert 'holds no points' in client.told[-1] and page._scan.value == page.name == 'corner'
        page.stop()


def test_a_full_disk_is_said_and_loses_nothing(opened, monkeypatch):
    page, semantic = opened
    client, click = Client(), page.guarded(page._clicked)
    click(at(page, few(semantic, 1)[0], client))

    def full(*arguments):
        raise OSError(28, 'No space left on device')

    with monkeypatch.context() as patched:
        patched.setattr('rm3d_plugin.annotation.click_log.os.write', full)
        click(at(page, few(semantic, 1)[1], client))
    assert 'No space left' in client.told[-1]
    assert len(read_clicks(page.session.log.path, page.session.classes)) == 1
    assert (page.session.scan('corner').annotated >= 0).sum() == 1


def test_what_could_not_be_saved_is_said_and_can_be_saved_again(opened, monkeypatch):
    page, semantic = opened
    client = Client()
    page.guarded(page._clicked)(at(page, few(semantic, 1)[0], client))
    with monkeypatch.context() as patched:
        patched.setattr(page.session, 'save', lambda out: (_ for _ in ()).throw(OSError(28, 'No space left on device')))
        page.guarded(lambda event: page._save(client))(SimpleNamespace(client=client))
    assert 'No space left' in client.told[-1] and 'not written yet: Save' in page._status.content
    page.guarded(lambda event: page._save(client))(SimpleNamespace(client=client))
    assert client.told[-1].startswith('saved: ') and 'saved: ' in page._status.content


def test_the_suggestion_is_shown_and_the_labels_settle_with_what_is_known_of_them(opened):
    page, semantic = opened
    client = Client()
    page._suggest(client)
    assert 'Click the red ball: much of the scan looks like this' in page._status.content
    np.testing.assert_allclose(client.camera.look_at, page.picture._mark.position)
    assert np.linalg.norm(client.camera.position - client.camera.look_at) <= 60.001 * page.picture._spacing
    for point in few(semantic, 6):
        page._class.value = page.session.classes[semantic[point]]
        page._clicked(at(page, point))
    page._settle()
    assert 'from 12 of your clicks' in page._status.content
    page._save(client)
    saved = read_ply(page._out.folder / 'corner.ply')
    assert (saved['label'] == semantic).mean() > 0.9 and 'saved: ' in client.told[-1]


def test_a_lasso_labels_what_it_holds(opened):
    page, semantic = opened
    client, xyz = Client(), page.session.scan('corner').cloud.xyz
    page._tool.value = 'lasso'
    half = 20 * np.tan(0.15)
    corners = [(0.3, 0.3), (2.0, 0.3), (2.0, 2.0), (0.3, 2.0), (0.3, 0.3)]  # on the floor, metres
    for x, y in corners:
        place = np.array([x, y, 0.0]) + [*xyz[semantic == 0].min(axis=0)[:2], 0]
        at_eye = place - client.camera.position
        screen = (0.5 + at_eye[0] / (2 * half), 0.5 - at_eye[1] / (2 * half))
        page.guarded(page._clicked)(
            SimpleNamespace(
                client=client, screen_pos=screen, ray_origin=tuple(client.camera.position), ray_direction=tuple(at_eye)
            )
        )
    found = np.flatnonzero(page.session.scan('corner').annotated >= 0)
    local = xyz[found] - xyz[semantic == 0].min(axis=0)
    assert 200 < len(found) <= 18 * 18 and (semantic[found] == 0).all()
    assert (local[:, :2] > 0.25).all() and (local[:, :2] < 2.05).all()
    assert page.session.undo() and not page.session.log.clicks
    page.guarded(lambda event: page._close_lasso(event.client))(SimpleNamespace(client=client))
    assert client.told[-1].startswith('no point in the lasso')


def test_an_object_gets_clicks_a_box_and_another_place_by_its_handles(opened):
    page, semantic = opened
    client, objects = Client(), page.session.objects
    page._class.value = 'wall'
    page.guarded(page.objects.fit)(SimpleNamespace(client=client))
    assert client.told[-1] == 'choose an object first, or begin one: key n'
    page.objects.begin(None)
    assert page.objects.number == 0 and page.objects._object.value == '0: new'
    for point in np.flatnonzero(semantic == 1)[::300]:
        page._clicked(at(page, point))
    page._class.value = 'floor'
    page.objects._object.value = 'none'
    for point in np.flatnonzero(semantic == 0)[::300]:
        page._clicked(at(page, point))
    page.objects._object.value = '0: wall'
    page.objects.fit(None)
    fitted = np.array(objects.boxes('corner')[0].row)
    np.testing.assert_allclose(fitted[3:6], [2.9, 0.05, 2.9], atol=0.3)
    target = SimpleNamespace(wxyz=(np.cos(0.05), 0.0, 0.0, np.sin(0.05)), position=page.objects._handles.position)
    page.objects._moved(SimpleNamespace(phase='update', target=target))
    assert tuple(fitted) == objects.boxes('corner')[0].row
    page.objects._moved(SimpleNamespace(phase='end', target=target))
    moved = np.array(objects.boxes('corner')[0].row)
    np.testing.assert_allclose(moved, [*fitted[:6], 0.1], atol=1e-3)
    page.objects._size.value = (3.0, 1.0, 4.0)
    page.objects._resized(None)
    sized = np.array(objects.boxes('corner')[0].row)
    np.testing.assert_allclose(sized[3:6], [3, 1, 4], atol=1e-3)
    np.testing.assert_allclose(sized[2] - 2, moved[2] - moved[5] / 2, atol=1e-3)  # it stands where it stood
    page.objects._export(SimpleNamespace(client=client))
    page.objects._file.value = str(page._out.folder / 'boxes' / 'labels' / 'corner.txt')
    page.objects._import(SimpleNamespace(client=client))
    assert client.told[-1] == '1 boxes of corner.txt' and sorted(objects.boxes('corner')) == [0, 1]
    page._undo(client)
    assert sorted(objects.boxes('corner')) == [0]


def test_a_second_tab_is_told(opened, monkeypatch):
    page, _ = opened
    clients = {0: Client(), 1: Client()}
    monkeypatch.setattr(page.server, 'get_clients', lambda: clients)
    page._joined(clients[1])
    assert [each.told for each in clients.values()] == 2 * [
        ['this page is open twice: both change one and the same session']
    ]


def test_a_click_need_not_wait_for_the_labels_to_settle_and_overtakes_them(opened, monkeypatch):
    page, semantic = opened
    monkeypatch.setattr('rm3d_plugin.annotation.page.SETTLE', 1000.0)  # it settles when asked, however slow the machine
    points, asked = few(semantic, 1), page.session.settled

    def slow(name):
        found = asked(name, check=False)
        worker = threading.Thread(target=page.guarded(page._clicked), args=(at(page, points[1]),))
        page._class.value = page.session.classes[semantic[points[1]]]
        worker.start()
        worker.join(30)
        assert not worker.is_alive()
        return found

    page._class.value = page.session.classes[semantic[points[0]]]
    page._clicked(at(page, points[0]))
    monkeypatch.setattr(page.session, 'settled', slow)
    page._settle()
    assert (page.session.scan('corner').annotated >= 0).sum() == 2
    assert 'estimate: when you pause' in page._status.content  # the answer to one click is not shown for two


def test_labels_that_settle_are_given_up_when_a_click_comes(opened, monkeypatch):
    page, semantic = opened
    monkeypatch.setattr('rm3d_plugin.annotation.page.SETTLE', 1000.0)
    points, asked, ended = few(semantic, 1), page.session.settled, []

    def overtaken(name):
        page.changed()  # as a click from another thread does
        try:
            ended.append(asked(name, check=False))
        except GivenUpError as error:
            ended.append(error)
            raise

    page._class.value = page.session.classes[semantic[points[0]]]
    page._clicked(at(page, points[0]))
    page._settle()
    assert 'no estimate' in page._status.content
    monkeypatch.setattr(page.session, 'settled', overtaken)
    page._settle()
    assert [type(each) for each in ended] == [GivenUpError]
    assert 'estimate: when you pause' in page._status.content


def test_a_label_that_the_others_contradict_is_shown_once(opened):
    page, semantic = opened
    client, wrong = Client(), int(few(semantic, 7)[6])
    for point in few(semantic, 6).tolist():
        page.session.click('corner', point, page.session.classes[semantic[point]])
    page.session.click('corner', wrong, 'wall')
    page.changed()
    page._check(client)
    assert 'Is the red ball right? It is labelled wall, the other labels say floor' in page._status.content
    place = page.session.scan('corner').cloud.xyz[wrong]
    np.testing.assert_allclose(page.picture._mark.position, place, atol=1e-6)
    page.view.by.value = 'check'
    page.view.compare()
    red, green, blue = page.picture._cloud.colors[page.picture.shown.tolist().index(wrong)]
    assert red > 2 * blue and red > 2 * green
    for _ in range(8):
        page._check(client)
    assert client.told[-1] == 'no label is left that the others contradict'


def test_labels_of_a_file_come_in_and_clicks_go_out(opened):
    page, semantic = opened
    client, panel = Client(), page.exchange
    panel._file.value = str(page._out.folder / 'nothing.csv')
    page.guarded(panel._import)(SimpleNamespace(client=client))
    assert 'no such file of labels' in client.told[-1]
    page._out.folder.mkdir()
    panel._file.value = str(page._out.folder / 'given.csv')
    (page._out.folder / 'given.csv').write_text('scene,index,class\ncorner,1,floor\ncorner,1001,wall\n')
    page.guarded(panel._import)(SimpleNamespace(client=client))
    assert client.told[-1] == '2 labels of given.csv (undo takes them back)'
    page.guarded(panel._export)(SimpleNamespace(client=client))
    assert [click.index for click in read_clicks(page._out.folder / 'clicks.csv', ('floor', 'wall'))] == [1, 1001]
    page._save(client)
    panel._file.value = str(page._out.folder / 'corner.ply')
    page.guarded(panel._import)(SimpleNamespace(client=client))
    assert client.told[-1] == '1800 labels of corner.ply (undo takes them back)'
    assert (page.session.scan('corner').annotated >= 0).all()
