"""The page: what a click does, without a browser; and in a real one where there is one."""

import shutil
import time
from types import SimpleNamespace

import numpy as np
import pytest
from reference.corner_scan import corner, few

from rm3d_plugin.annotation import Session, read_clicks
from rm3d_plugin.storage.ply import read_ply, write_ply

pytest.importorskip('viser', reason='the page needs rm3d_plugin[annotate]')
from rm3d_plugin.annotation.page import AnnotationPage  # noqa: E402

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
GRAPHICS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist']


class Client:
    """A browser that keeps what it is told."""

    def __init__(self):
        self.told = []
        self.camera = SimpleNamespace(position=np.array([0.0, 0.0, 20.0]), look_at=np.zeros(3))

    def add_notification(self, title, text, **options):
        self.told.append(text)


@pytest.fixture
def opened(tmp_path):
    """A page on a floor and a wall, and the classes of the points."""
    xyz, semantic = corner((4e5, 5e6, 100.0))
    path = write_ply(tmp_path / 'corner.ply', {axis: xyz[:, i] for i, axis in enumerate('xyz')})
    with Session([path], classes=['floor', 'wall']) as session:
        page = AnnotationPage(session, tmp_path / 'out', port=18080)
        yield page, semantic
        page.stop()


def at(page, point, client=None):
    """A click that is aimed at a point."""
    place = page.session.scan('corner').cloud.xyz[point]
    eye = place + np.array([-2.0, -2.0, 2.0])
    return SimpleNamespace(client=client or Client(), ray_origin=tuple(eye), ray_direction=tuple(place - eye))


def test_a_click_labels_the_point_under_it_and_the_picture_follows(opened):
    page, semantic = opened
    points, click = few(semantic, 1), page._guarded(page._clicked)
    for number, name in enumerate(page.session.classes):
        page._class.value = name
        click(at(page, points[number]))
    labelled = np.flatnonzero(page.session.scan('corner').annotated >= 0)
    xyz = page.session.scan('corner').cloud.xyz
    near = np.linalg.norm(xyz[labelled][:, None] - xyz[points], axis=2).min(axis=0)
    assert len(labelled) == 2 and near.max() < 0.3
    assert page._by.value == 'class' and (page._labels.semantic == semantic).mean() > 0.85
    assert 'every click is kept' in page._status.content
    page._undo(Client())
    assert (page.session.scan('corner').annotated >= 0).sum() == 1


def test_what_cannot_be_is_said_on_the_page(opened):
    page, semantic = opened
    client = Client()
    away = SimpleNamespace(client=client, ray_origin=(0.0, 0.0, 50.0), ray_direction=(0.0, 0.0, 1.0))
    page._guarded(page._clicked)(away)
    page._guarded(lambda event: page._save(event.client))(SimpleNamespace(client=client))
    page._guarded(lambda event: page._undo(event.client))(SimpleNamespace(client=client))
    assert client.told[0] == 'no point there: click on a point of the scan'
    assert client.told[1] == 'nothing to save: no point is labelled yet'
    assert client.told[2] == 'nothing to undo'


def test_a_scan_that_cannot_be_read_is_said_and_the_one_before_stays(tmp_path):
    xyz, _ = corner()
    columns = {axis: xyz[:, i] for i, axis in enumerate('xyz')}
    scans = [write_ply(tmp_path / 'corner.ply', columns)]
    scans.append(write_ply(tmp_path / 'empty.ply', {axis: values[:0] for axis, values in columns.items()}))
    with Session(scans, classes=['floor']) as session:
        page, client = AnnotationPage(session, tmp_path / 'out', port=18080), Client()
        page._scan.value = 'empty'
        page._guarded(lambda event: page._switch('empty'))(SimpleNamespace(client=client))
        assert 'holds no points' in client.told[-1] and page._scan.value == page._name == 'corner'
        page.stop()


def test_a_full_disk_is_said_and_loses_nothing(opened, monkeypatch):
    page, semantic = opened
    client, click = Client(), page._guarded(page._clicked)
    click(at(page, few(semantic, 1)[0], client))

    def full(*arguments):
        raise OSError(28, 'No space left on device')

    with monkeypatch.context() as patched:
        patched.setattr('rm3d_plugin.annotation.click_log.os.write', full)
        click(at(page, few(semantic, 1)[1], client))
    assert 'No space left' in client.told[-1]
    assert len(read_clicks(page.session.log.path, page.session.classes)) == 1
    assert (page.session.scan('corner').annotated >= 0).sum() == 1


def test_the_suggestion_is_shown_and_the_labels_settle_with_what_is_known_of_them(opened):
    page, semantic = opened
    client = Client()
    page._suggest(client)
    assert 'Click the red ball: much of the scan looks like this' in page._status.content
    for point in few(semantic, 6):
        page._class.value = page.session.classes[semantic[point]]
        page._clicked(at(page, point))
    page._settle()
    assert 'from 12 of your clicks' in page._status.content
    page._save(client)
    saved = read_ply(page._out / 'corner.ply')
    assert (saved['label'] == semantic).mean() > 0.9 and 'saved: ' in client.told[-1]


@pytest.mark.skipif(CHROMIUM is None, reason='no chromium on this machine')
def test_in_a_browser(opened):
    playwright = pytest.importorskip('playwright.sync_api', reason='needs playwright')
    page, _ = opened
    log, names = page.session.log.path, page.session.classes
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=GRAPHICS)
        tab = browser.new_page(viewport={'width': 900, 'height': 600})
        tab.set_default_timeout(120_000)
        tab.goto(page.url)
        tab.wait_for_selector('text=Where to click next')
        clicked = False
        for _ in range(10):  # until the scene stands
            tab.mouse.click(300, 320)
            clicked = clicked or _within(5, lambda: len(page.session.log.clicks) > 0)
            if clicked:
                break
        assert clicked and read_clicks(log, names)[0].semantic == 0
        tab.wait_for_selector('text=every click is kept')
        before = len(page.session.log.clicks)
        tab.get_by_role('button', name='Undo').click()
        assert _within(60, lambda: len(page.session.log.clicks) == before - 1)
        tab.get_by_role('button', name='Redo').click()
        assert _within(60, lambda: len(page.session.log.clicks) == before)
        tab.get_by_role('button', name='Save').click()
        assert _within(60, lambda: (page._out / 'corner.ply').exists())
        browser.close()
    with Session([log.with_name('corner.ply')], log=log) as again:  # as after a reload
        assert len(again.log.clicks) == before


def _within(seconds, done):
    ends = time.monotonic() + seconds
    while not done() and time.monotonic() < ends:
        time.sleep(0.1)
    return done()
