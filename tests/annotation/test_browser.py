"""The page in a real browser, on a made-up room and on a real street (`make browser`); RM3D_BROWSER=train trains, too.

A picture of every step is kept where RM3D_PICTURES names a folder, beside the scan elsewhere. A page that draws and
does not answer is a failure; a browser that does not start, or draws too slowly to be done within `LIFETIME` seconds,
is told and passed over: graphics without a GPU take the whole machine.
"""

import contextlib
import io
import itertools
import os
import shutil
import time
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from rm3d_plugin.annotation import Session, demo_room
from rm3d_plugin.annotation.demo_room import write_demo_room
from rm3d_plugin.datasets.oakland_format import read_tile
from rm3d_plugin.datasets.scannet_format import CLASSES, class_of_nyu40
from rm3d_plugin.datasets.synthetic.rooms import make_room
from rm3d_plugin.experiments.scenes import real_root
from rm3d_plugin.storage.ply import read_ply, write_ply

pytest.importorskip('viser', reason='the page needs rm3d_plugin[annotate]')
playwright = pytest.importorskip('playwright.sync_api', reason='needs playwright')
from rm3d_plugin.annotation.page import AnnotationPage, Outputs  # noqa: E402

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
GRAPHICS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist']
LIFETIME = 130  # seconds of a browser; half of that without load
ENDS = time.monotonic() + 210  # of all browsers together
MINUTES = 4.0  # of a training
PATIENCE = 30  # seconds for one answer, and longer
FRAMES = 300  # until the page has drawn so many: on a slow machine an answer comes late
STARTS = 15  # seconds in which a browser starts; a second without load
DRAWS = "() => !!document.createElement('canvas').getContext('webgl2')"
COUNTS = 'window.drawn = 0; (function draw() { window.drawn += 1; requestAnimationFrame(draw) })()'
POINTS = 20_000
DRAWN = 25  # thousand points of the picture
TILE = real_root() / 'oakland' / 'oakland_part3_ap.xyz_label_conf'
AROUND = ((0.4, 0.5), (0.6, 0.5), (0.5, 0.4), (0.42, 0.42), (0.58, 0.42), (0.35, 0.5), (0.65, 0.5))  # an object
PLACES = [(0.3, 0.4), (0.45, 0.55), (0.65, 0.5), (0.46, 0.41), (0.35, 0.55)]  # of the picture, one a class

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason='no chromium on this machine'),
    pytest.mark.skipif('RM3D_BROWSER' not in os.environ, reason='minutes of graphics without a GPU: make browser'),
]


def room(folder):
    return write_demo_room(folder)


def street(folder):
    if not TILE.is_file():
        pytest.skip(f'{TILE}: no such real scan')
    xyz = read_tile(TILE).xyz
    kept = np.random.default_rng(0).permutation(len(xyz))[:POINTS]
    return write_ply(folder / 'street.ply', {axis: xyz[kept, i] for i, axis in enumerate('xyz')})


@pytest.mark.parametrize('make', [room, street])
def test_in_a_browser(make, tmp_path):
    scan = make(tmp_path)
    classes = [f'{make.__name__} {number}' for number in range(5)]
    with Session([scan], classes=classes) as session, shown(session, tmp_path) as page, chromium(tmp_path) as browser:
        with opened(browser, page, tmp_path) as tab:
            label_five_classes(tab, session)
            accept_a_suggestion(tab, session)
            box_an_object(tab, session)
            tab.picture(f'annotate_{make.__name__}_box')
            tab.get_by_role('button', name='Save').click()
            assert within(tab, lambda: 'saved: ' in tab.content())
        expected, annotated = session.settled(scan.stem, check=False), session.scan(scan.stem).annotated
        with opened(browser, page, tmp_path) as tab:  # as after a reload
            assert within(tab, lambda: classes[4] in tab.content())
    written = read_ply(tmp_path / 'out' / scan.name)
    np.testing.assert_array_equal(written['label'], expected.semantic)
    np.testing.assert_array_equal(written['region'], expected.region)
    np.testing.assert_allclose(written['x'], read_ply(scan)['x'])
    with Session([scan]) as again:
        np.testing.assert_array_equal(again.scan(scan.stem).annotated, annotated)
        assert len(again.objects.boxes(scan.stem)) == 1


@pytest.mark.skipif(os.environ.get('RM3D_BROWSER') != 'train', reason='minutes of training: RM3D_BROWSER=train')
def test_a_training_in_a_browser(tmp_path):
    """An object with its box among labels; then minutes of training, and its difference is taken over."""
    scan, (semantic, instance) = write_demo_room(tmp_path), truth_of_demo_room()
    present = [CLASSES[number] for number in np.unique(semantic) if number >= 0]
    with (
        Session([scan], classes=present) as session,
        shown(session, tmp_path) as page,
        chromium(tmp_path, 1000) as browser,
    ):
        page.view.most.value = 400
        chair = label_by_truth(session, semantic, instance)
        page.changed()
        page.objects._choose(0)
        page.objects.fit(None)
        page.training._minutes.value = MINUTES
        with opened(browser, page, tmp_path) as tab:
            tab.locator('.mantine-Notification-closeButton').first.click()
            tab.picture('annotate_overview')
            for client in page.server.get_clients().values():
                page.picture.look_at(client, chair)
            tab.wait_for_timeout(5000)
            tab.picture('annotate_object')
            tab.get_by_text('Training').click()
            tab.get_by_role('button', name='Train', exact=True).click()
            assert within(tab, lambda: not page.training.running, 800)
            assert within(tab, lambda: 'points would change' in tab.content())
            tab.wait_for_timeout(5000)
            tab.picture('annotate_difference')
            count = len(session.log.clicks)
            tab.get_by_role('button', name='Accept').click()
            assert within(tab, lambda: 'points accepted' in tab.content())
            assert len(session.log.clicks) > count


def truth_of_demo_room():
    """Class and object of each point."""
    room = make_room(demo_room.SEED, 0, demo_room.SPACING)
    kept = np.random.default_rng(0).permutation(len(room))[: demo_room.POINTS]
    return class_of_nyu40(room.nyu40[kept]), room.instance[kept]


def label_by_truth(session, semantic, instance):
    """Three clicks a class, and five of object 0, a chair; one of its points."""
    generator = np.random.default_rng(0)
    for name in session.classes:
        own = np.flatnonzero(semantic == CLASSES.index(name))
        for point in generator.choice(own, min(len(own), 3), replace=False).tolist():
            session.click('room', point, name)
    chairs = np.flatnonzero(semantic == CLASSES.index('chair'))
    largest = np.bincount(instance[chairs]).argmax()
    points = generator.choice(chairs[instance[chairs] == largest], 5, replace=False).tolist()
    session.brush('room', points, 'chair', 0)
    return points[0]


@contextlib.contextmanager
def chromium(folder, seconds=LIFETIME):
    """A browser for so many seconds; skips where none starts, none draws, or its time is over."""
    if seconds <= LIFETIME:
        seconds = min(seconds, ENDS - time.monotonic())
    if seconds < PATIENCE:
        pytest.skip('too busy a machine: no time is left for this one')
    script = folder / 'chromium'
    script.write_text(f'#!/bin/sh\nexec timeout -s KILL {seconds:.0f} {CHROMIUM} "$@"\n')
    script.chmod(0o755)
    with playwright.sync_playwright() as started:
        began = time.monotonic()
        try:
            browser = started.chromium.launch(executable_path=script, args=GRAPHICS, timeout=1000 * PATIENCE)
            draws = browser.new_page().evaluate(DRAWS)
        except playwright.Error as error:
            pytest.skip(f'{CHROMIUM} does not start: {error}')
        took = time.monotonic() - began
        if not draws or took > STARTS:
            browser.close()
            pytest.skip(f'{CHROMIUM} is ready after {took:.0f} s, {"with" if draws else "without"} WebGL')
        try:
            yield browser
        except playwright.Error as error:
            if browser.is_connected() or time.monotonic() - began < seconds - 1:
                raise
            pytest.skip(f'not done within {seconds:.0f} s, too busy a machine: {error}')
        browser.close()


@contextlib.contextmanager
def shown(session, folder):
    """The page of a session; few points are drawn, a frame of many takes long without a GPU."""
    page = AnnotationPage(session, Outputs(folder / 'out'), port=18090)
    page.view.most.value = DRAWN
    page.view.draw()
    try:
        yield page
    finally:
        page.stop()


@contextlib.contextmanager
def opened(browser, page, folder):
    """A tab in which the page stands; its last picture is kept, and the page must not complain."""
    tab, complaints = browser.new_page(viewport={'width': 1000, 'height': 640}), []
    tab.set_default_timeout(1000 * LIFETIME)  # what comes late is judged by `within`
    tab.add_init_script(COUNTS)
    tab.on('console', lambda said: complaints.append(said.text) if said.type == 'error' else None)
    tab.picture = partial(picture, tab, Path(os.environ.get('RM3D_PICTURES', folder)))
    try:
        tab.goto(page.url)
        assert within(tab, lambda: 'Where to click next' in tab.content() and tab.locator('canvas').count())
        yield tab
        assert not complaints
    finally:
        with contextlib.suppress(playwright.Error):  # the browser may be gone
            tab.picture('annotate_last')
            tab.close()


def click_at(tab, place):
    """Click a place of the picture, in [0, 1] from the upper left."""
    box = tab.locator('canvas').first.bounding_box()
    tab.mouse.click(box['x'] + place[0] * box['width'], box['y'] + place[1] * box['height'])


def label_five_classes(tab, session):
    """Choose each class by its key and click; then undo and redo the last."""
    for number, place in enumerate(PLACES):
        tab.keyboard.press(str(number + 1))
        click_until(tab, place, lambda number=number: number in given(session))
    count = settled_count(tab, session)
    tab.keyboard.press('Control+z')
    assert within(tab, lambda: len(session.log.clicks) == count - 1)
    tab.keyboard.press('Control+Shift+Z')
    assert within(tab, lambda: len(session.log.clicks) == count)
    tab.picture('annotate_classes')


def click_until(tab, place, done):
    """Click a place of the picture, and beside it where nothing comes of it, as before the scene stands."""
    attempts = itertools.count()

    def tried():
        click_at(tab, np.add(place, 0.01 * (next(attempts) % 9)))
        return soon(tab, done)

    assert within(tab, tried)


def given(session):
    """Classes with a click."""
    return {click.semantic for click in session.log.clicks}


def settled_count(tab, session):
    """Clicks, when no more are on their way."""
    count = -1
    while count != len(session.log.clicks):
        count = len(session.log.clicks)
        tab.wait_for_timeout(2000)
    return count


def accept_a_suggestion(tab, session):
    """Jump to the place that is suggested, which is then the middle of the picture, and click it."""
    count = len(session.log.clicks)
    tab.keyboard.press(' ')
    assert within(tab, lambda: 'Click the red ball' in tab.content())
    assert within(tab, lambda: red(tab, (0.5, 0.5)))
    tab.picture(f'annotate_{session.scans[0]}_suggestion')
    tab.keyboard.press('1')
    click_at(tab, (0.5, 0.5))
    assert within(tab, lambda: len(session.log.clicks) == count + 1)


def red(tab, place):
    """Whether a place of the picture is as red as the ball of a suggestion."""
    box = tab.locator('canvas').first.bounding_box()
    x, y = (box[low] + at * box[size] for low, size, at in zip('xy', ('width', 'height'), place, strict=True))
    taken = tab.screenshot(clip={'x': x - 1, 'y': y - 1, 'width': 3, 'height': 3})
    r, g, b = plt.imread(io.BytesIO(taken))[..., :3].mean(axis=(0, 1))
    return r > 1.3 * max(g, b) and 2 * b > g


def box_an_object(tab, session):
    """Label what is around an object first, or its rectangle takes most of the scan; begin it, click it, fit a box."""
    scan = session.scans[0]
    shares = np.bincount(session.labels(scan).semantic, minlength=5)
    rarest, commonest = shares.argmin(), shares.argmax()  # an object is not most of the scan
    tab.keyboard.press(str(commonest + 1))
    for place in AROUND:
        count = len(session.log.clicks)
        click_until(tab, place, lambda count=count: len(session.log.clicks) > count)
    count = settled_count(tab, session)
    for key in 'n', str(rarest + 1):
        tab.keyboard.press(key)
    tab.wait_for_timeout(500)
    click_until(tab, (0.5, 0.5), lambda: len(session.log.clicks) > count)
    count = settled_count(tab, session)
    box = tab.locator('canvas').first.bounding_box()
    tab.keyboard.down('Shift')
    tab.mouse.move(box['x'] + 0.48 * box['width'], box['y'] + 0.48 * box['height'])
    tab.mouse.down()
    tab.mouse.move(box['x'] + 0.52 * box['width'], box['y'] + 0.52 * box['height'], steps=5)
    tab.mouse.up()
    tab.keyboard.up('Shift')
    assert within(tab, lambda: len(session.log.clicks) > count)
    tab.keyboard.press('b')
    assert within(tab, lambda: session.objects.boxes(scan))


def picture(tab, folder, name):
    folder.mkdir(parents=True, exist_ok=True)
    tab.screenshot(path=folder / f'{name}.png')
    print(f'picture: {folder / name}.png')


def within(tab, done, seconds=PATIENCE):
    """Whether it is done within so many seconds, or before the page has drawn `FRAMES` more frames if that is later."""
    until, drawn = time.monotonic() + seconds, tab.evaluate('window.drawn')
    while not done():
        if time.monotonic() > until and tab.evaluate('window.drawn') > drawn + FRAMES:
            return False
        tab.wait_for_timeout(100)
    return True


def soon(tab, done):
    """Whether it is done within five seconds."""
    until = time.monotonic() + 5
    while not done() and time.monotonic() < until:
        tab.wait_for_timeout(100)
    return bool(done())
