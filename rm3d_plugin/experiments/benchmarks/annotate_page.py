"""How long the page of ``rm3d annotate`` takes to open a scan, and from a click in a browser to the changed colours."""

import argparse
import shutil
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.annotation.point_view import SHOWN
from rm3d_plugin.annotation.session import Session
from rm3d_plugin.datasets.synthetic.rooms import make_room
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.benchmarks.measure import forget_peak, machine, memory_mb
from rm3d_plugin.storage.ply import write_ply

NAME = 'annotate-page'
HELP = 'seconds to open a scan on the page, and from a click to changed colours in Chromium'
GRAPHICS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist']
ROOM_SEED = 7
SPACINGS = {100_000: 0.02, 1_000_000: 0.006}  # m between points of a room that has as many, and more
CLASSES = ('a', 'b', 'c')
LEAST = 3  # bytes a shown point, of a buffer that holds its colours
WAIT = 300.0  # seconds for an answer, at most
STROKE = 100_000  # points that are labelled at once
REPEATS = 5  # of labels without a browser
FRAMES = '() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))'  # two are drawn
WATCH = """
window.rm3d = {clicked: 0, coloured: 0, drawn: 0};
addEventListener('pointerup', () => Object.assign(rm3d, {clicked: performance.now(), coloured: 0, drawn: 0}), true);
for (const name of ['bufferData', 'bufferSubData']) {
  const own = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...args) {
    const data = args.find(each => ArrayBuffer.isView(each));
    if (rm3d.clicked && !rm3d.coloured && data && data.byteLength >= LEAST) {
      rm3d.coloured = performance.now();
      requestAnimationFrame(() => requestAnimationFrame(() => { rm3d.drawn = performance.now(); }));
    }
    return own.apply(this, args);
  };
}
"""  # times of a click, of colours that come to the graphics, and of the frame after the one that shows them


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmark."""
    parser.add_argument('--points', type=int, nargs='*', default=list(SPACINGS), help='of made-up rooms')
    parser.add_argument('--scans', type=Path, nargs='*', default=[], help='further scans')
    parser.add_argument('--clicks', type=int, default=5, help='in the browser; 0: the page is opened alone')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Seconds and memory by scan."""
    if args.clicks < 0 or min(args.points, default=1) < 1:
        raise ConfigError(
            f'--points, --clicks: expected points from 1 and clicks from 0, got {args.points}, {args.clicks}'
        )
    out: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for count in args.points:
            path = _room(Path(folder), count)
            out[f'room of {count} points'] = measure(path, Path(folder), args.clicks)
        for path in args.scans:
            out[path.name] = measure(path, Path(folder), args.clicks)
    return out | {'machine': machine()}


def _room(folder: Path, count: int) -> Path:
    spacing = next((own for most, own in SPACINGS.items() if most >= count), min(SPACINGS.values()))
    room = make_room(ROOM_SEED, 0, spacing)
    if len(room) < count:
        raise ConfigError(f'--points: a room has at most {len(room)} points, got {count}')
    kept = np.random.default_rng(0).permutation(len(room))[:count]
    return write_ply(folder / f'room{count}.ply', {axis: room.aligned[kept, i] for i, axis in enumerate('xyz')})


def measure(scan: Path, folder: Path, clicks: int) -> dict[str, Any]:
    """Open a scan, label it without a browser, and click in one.

    Args:
        scan: The file.
        folder: For the log.
        clicks: Timed ones in the browser; one before them is not.
    """
    from rm3d_plugin.annotation.page import AnnotationPage, Outputs  # viser is an extra

    forget_peak()
    began, spent = time.perf_counter(), time.process_time()
    with Session([scan], folder / f'{scan.stem}.jsonl', CLASSES) as session:
        page = AnnotationPage(session, Outputs(folder / 'out'), port=18100)
        found = {'open, s': round(time.perf_counter() - began, 1)}
        found['open, s of processor'] = round(time.process_time() - spent, 1)
        try:
            if clicks:
                found |= _answers(page, session, clicks)
        finally:
            page.stop()
        found |= _labels(session, session.scans[0])
    return found | {'peak memory, MB': memory_mb('VmHWM')}


def _labels(session: Session, scan: str) -> dict[str, float]:
    """Median seconds of processor until every point has its label: after a click, and after a stroke."""
    count = len(session.scan(scan).cloud)
    along = np.argsort(session.scan(scan).cloud.xyz[:, 0], kind='stable')
    strokes = {'click': 1, f'stroke of {min(STROKE, count)}': min(STROKE, count)}
    out: dict[str, float] = {}
    for name, size in strokes.items():
        times, starts = [], np.linspace(0, count - size, REPEATS + 1).astype(np.int64)
        for number, start in enumerate(starts.tolist()):
            spent = time.process_time()
            session.brush(scan, along[start : start + size].tolist(), CLASSES[number % len(CLASSES)])
            session.labels(scan)
            times.append(time.process_time() - spent)
        out[f'{name} to labels, s of processor'] = round(statistics.median(times[1:]), 3)
    return out


def _answers(page: Any, session: Session, clicks: int) -> dict[str, float]:
    """Seconds from a click to its colours in the graphics, and to the frame after the one that shows them."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which('chromium') or shutil.which('chromium-browser')
    if chromium is None:
        raise ConfigError('annotate-page: needs chromium; --clicks 0 opens the page alone')
    least = LEAST * min(len(session.scan(page.name).cloud), SHOWN)
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=chromium, args=GRAPHICS)
        tab = browser.new_page(viewport={'width': 900, 'height': 600})
        tab.set_default_timeout(1000 * WAIT)
        tab.add_init_script(WATCH.replace('LEAST', str(least)))
        tab.goto(page.url)
        tab.wait_for_selector('canvas')
        frame_alone = _frame(tab)
        times = [_click(tab, number) for number in range(clicks + 1)][1:]
        browser.close()
    colours, frame = zip(*times, strict=True)
    return {
        'frame of a turning view, s': round(frame_alone, 2),
        'click to colours, s': round(statistics.median(colours), 2),
        'click to colours, least s': round(min(colours), 2),
        'click to the next frame, s': round(statistics.median(frame), 2),
        'click to the next frame, least s': round(min(frame), 2),
    }


def _frame(tab: Any) -> float:
    """Median seconds of a frame while the view is turned."""
    tab.wait_for_timeout(2500)
    tab.mouse.move(300, 300)
    tab.mouse.down()
    times = []
    for step in range(REPEATS):
        began = time.perf_counter()
        tab.mouse.move(310 + 9 * step, 300 + 4 * step)
        tab.evaluate(FRAMES)
        times.append((time.perf_counter() - began) / 2)
    tab.mouse.up()
    return statistics.median(times)


def _click(tab: Any, number: int) -> tuple[float, float]:
    """Seconds by the browser's clock, see :data:`WATCH`; a click beside all is repeated."""
    until = time.perf_counter() + WAIT
    while time.perf_counter() < until:
        tab.wait_for_timeout(2500)  # what settles after the click before has come
        tab.keyboard.press('123'[number % 3])
        tab.mouse.click(250 + 23 * number, 300 + 17 * (number % 4))
        last = time.perf_counter() + 30
        while time.perf_counter() < last:
            tab.wait_for_timeout(100)
            found = tab.evaluate('() => rm3d')
            if found['drawn']:
                return (found['coloured'] - found['clicked']) / 1000, (found['drawn'] - found['clicked']) / 1000
    raise ConfigError(f'annotate-page: no answer to a click within {WAIT:g} s')
