"""The page in a browser: a scan to look at and to click, its labels, and where the next click is worth most."""

import html
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import viser
from jaxtyping import Int
from viser.transforms import SO3

from rm3d_plugin.annotation.annotated_scan import AnnotatedScan
from rm3d_plugin.annotation.point_view import (
    COLOR_BY,
    Camera,
    ColorBy,
    colors_by,
    point_hit,
    points_in_rectangle,
)
from rm3d_plugin.annotation.session import Session
from rm3d_plugin.inference.label_scan import LabelledScan
from rm3d_plugin.structures import UNLABELLED
from rm3d_plugin.user_error import UserError

Tool = Literal['point', 'region', 'rectangle', 'eraser']
TOOLS: tuple[Tool, ...] = get_args(Tool)
SHOWN = 400_000  # points of the picture, at most; labels are on all
SETTLE = 1.5  # seconds without an action, after which the labels are computed as they are written, with the estimate
FIRST_KEYS = '123456789'
MARK = 'suggestion'
MOST_DOTS = 5000  # labelled points that are marked


class AnnotationPage:
    """A session shown in a browser; it runs until :meth:`stop`.

    Args:
        session: The scans and their clicks.
        out: Folder for what is saved.
        port: On this machine alone; others reach it through a tunnel.
    """

    def __init__(self, session: Session, out: Path, port: int = 8080) -> None:
        self.session, self._out = session, out
        self._lock = threading.RLock()
        self._timer: threading.Timer | None = None
        self._mark: Any = None
        self._note, self._estimate, self._saved = '', '', 'nothing to save yet'
        self.server = viser.ViserServer(host='127.0.0.1', port=port, label='rm3d annotate', verbose=False)
        self.server.scene.set_up_direction('+z')
        self.server.gui.configure_theme(dark_mode=True, show_logo=False)
        self.server.gui.main_panel.dock_right()
        self._controls()
        self._keys()
        self.server.scene.on_click()(self._guarded(self._clicked))
        self.server.scene.on_rect_select(modifier='shift')(self._guarded(self._dragged))
        self.server.on_client_connect(self._guarded(self._joined))
        self._open(session.scans[0])

    @property
    def url(self) -> str:
        """Where the page is."""
        return f'http://127.0.0.1:{self.server.get_port()}'

    def stop(self) -> None:
        """End it; every click is on the disk."""
        if self._timer is not None:
            self._timer.cancel()
        self.server.stop()

    # ------------------------------------------------------------------ what is seen

    def _controls(self) -> None:
        gui, scans = self.server.gui, self.session.scans
        self._scan: Any = gui.add_dropdown('Scan', scans, visible=len(scans) > 1)
        self._status = gui.add_html('')
        self._tool = gui.add_dropdown('Tool', TOOLS, hint='shift and drag: all points in a rectangle')
        self._class: Any = gui.add_dropdown('Class', self._names(), hint='keys 1 to 9')
        with gui.add_folder('Classes', expand_by_default=not self.session.classes):
            self._new: Any = gui.add_text('Name', '')
            self._color = gui.add_rgb('Colour', (0, 114, 178))
            gui.add_button('Add').on_click(self._guarded(self._add_class))
            gui.add_button('Rename').on_click(self._guarded(self._rename_class))
            gui.add_button('Set colour').on_click(self._guarded(self._recolour))
        for name, action in (
            ('Undo (ctrl z)', self._undo),
            ('Redo (ctrl shift z)', self._redo),
            ('Where to click next (space)', self._suggest),
            ('Save', self._save),
        ):
            gui.add_button(name).on_click(self._guarded(_of_client(action)))
        with gui.add_folder('View'):
            self._by: Any = gui.add_dropdown('Colour by', COLOR_BY, initial_value='colour')
            self._size = gui.add_slider('Point size', 0.25, 4.0, 0.25, 1.0)
            self._heights = gui.add_multi_slider('Heights, %', 0, 100, 1, (0, 100))
        self._scan.on_update(self._guarded(lambda event: self._switch(self._scan.value)))
        self._by.on_update(self._guarded(lambda event: self._paint()))
        self._size.on_update(self._guarded(lambda event: self._draw()))
        self._heights.on_update(self._guarded(lambda event: self._draw()))

    def _keys(self) -> None:
        gui = self.server.gui
        for number, key in enumerate(FIRST_KEYS):
            command = gui.add_command(f'Class {number + 1}', hotkey=key)  # type: ignore[arg-type]
            command.on_trigger(self._guarded(partial(self._choose, number)))
        for label, key, modifier, act in (
            ('Undo', 'Z', 'cmd/ctrl', self._undo),
            ('Redo', 'Z', 'cmd/ctrl+shift', self._redo),
            ('Where to click next', 'space', None, self._suggest),
        ):
            command = gui.add_command(label, hotkey=key, modifier=modifier)  # type: ignore[arg-type]
            command.on_trigger(self._guarded(_of_client(act)))

    def _open(self, name: str) -> None:
        """Show a scan."""
        self._current: AnnotatedScan = self.session.scan(name)
        self._name, self._note, self._estimate = name, '', ''
        xyz = self._current.cloud.xyz
        self._labels: LabelledScan = self.session.labels(name)
        low, high = np.quantile(xyz, [0.02, 0.98], axis=0)
        middle, reach = (low + high) / 2, float(np.linalg.norm(high - low))
        self.server.initial_camera.look_at = tuple(middle)
        self.server.initial_camera.position = tuple(middle + reach * np.array([0.15, -0.45, 0.75]))
        if self._mark is not None:
            self._mark.remove()
        self._draw()
        self._dots()
        self._told()

    def _switch(self, name: str) -> None:
        """Show another scan; where it cannot be read, the one that is shown stays chosen."""
        if name == self._name:
            return
        try:
            self._open(name)
        finally:
            self._scan.value = self._name

    def _draw(self) -> None:
        """Send the points that are shown."""
        xyz = self._current.cloud.xyz
        low, high = np.percentile(xyz[:, 2], np.asarray(self._heights.value, dtype=np.float64))
        step = -(-len(xyz) // SHOWN)
        every = np.arange(0, len(xyz), step)
        self._shown: Int[np.ndarray, ' shown'] = every[(xyz[every, 2] >= low) & (xyz[every, 2] <= high)]
        self._width = float(self._size.value) * self._current.scene.spacing * np.sqrt(step) / 2
        self._cloud = self.server.scene.add_point_cloud(
            'scan', xyz[self._shown], self._colors(), point_size=self._width, point_shape='circle', precision='float32'
        )

    def _paint(self) -> None:
        """Send colours alone."""
        self._cloud.colors = self._colors()

    def _colors(self) -> np.ndarray:
        kind: ColorBy = self._by.value
        colors = [self.session.color(name) for name in self.session.classes]
        return colors_by(kind, self._current.cloud, self._labels, colors)[self._shown]

    def _dots(self) -> None:
        """Show where labels were given."""
        points = np.flatnonzero(self._current.annotated >= 0)
        points = points[:: -(-len(points) // MOST_DOTS) or 1]
        xyz, white = self._current.cloud.xyz[points], np.full((len(points), 3), 255, np.uint8)
        self.server.scene.add_point_cloud(
            'clicks', xyz, white, point_size=3 * self._width, point_shape='circle', precision='float32'
        )

    def _told(self) -> None:
        """Counts, estimate, suggestion and whether all is saved."""
        rows, annotated = [], self._current.annotated
        for number, name in enumerate(self.session.classes):
            clicks = int(np.count_nonzero(annotated == number))
            share = 100 * float((self._labels.semantic == number).mean())
            key = FIRST_KEYS[number : number + 1]
            rows.append(
                f'<tr><td style="color:{self.session.color(name)}">&#9632;</td><td>{key}</td>'
                f'<td>{html.escape(name)}</td><td>{clicks}</td><td>{share:.0f} %</td></tr>'
            )
        table = '<table><tr><th></th><th>key</th><th>class</th><th>clicked</th><th>of points</th></tr>'
        lines = [self._note, self._estimate, self._saved]
        text = ''.join(f'<p>{html.escape(line)}</p>' for line in lines if line)
        self._status.content = f'<div style="padding:0.6em">{table}{"".join(rows)}</table>{text}</div>'

    def _names(self) -> tuple[str, ...]:
        return self.session.classes or ('add a class first',)

    # ------------------------------------------------------------------ actions

    def _clicked(self, event: Any) -> None:
        point = self._met(event)
        if point is None:
            self._say(event.client, 'no point there: click on a point of the scan')
            return
        if self._tool.value == 'region':
            self.session.region(self._name, point, self._class_name())
        elif self._tool.value == 'eraser':
            self.session.erase(self._name, [point])
        else:
            self.session.click(self._name, point, self._class_name())
        self._changed()

    def _dragged(self, event: Any) -> None:
        camera = event.client.camera
        rotation = SO3(np.asarray(camera.wxyz)).as_matrix()
        seen = Camera(np.asarray(camera.position), rotation, float(camera.fov), float(camera.aspect))
        rows = points_in_rectangle(self._current.cloud.xyz[self._shown], seen, event.screen_min, event.screen_max)
        if not len(rows):
            self._say(event.client, 'no point in this rectangle')
            return
        points = self._shown[rows].tolist()
        if self._tool.value == 'eraser':
            self.session.erase(self._name, points)
        else:
            self.session.brush(self._name, points, self._class_name())
        self._changed()

    def _met(self, event: Any) -> int | None:
        xyz = self._current.cloud.xyz[self._shown]
        row = point_hit(xyz, event.ray_origin, event.ray_direction, self._width)
        return None if row is None else int(self._shown[row])

    def _undo(self, client: Any) -> None:
        if not self.session.undo():
            self._say(client, 'nothing to undo')
        self._changed()

    def _redo(self, client: Any) -> None:
        if not self.session.redo():
            self._say(client, 'nothing to redo')
        self._changed()

    def _suggest(self, client: Any) -> None:
        """Look at the place whose label would tell most."""
        found = self.session.suggest(self._name)
        if not found:
            self._say(client, 'every place was suggested')
            return
        place = self._current.cloud.xyz[found[0].point].astype(np.float64)
        self._mark = self.server.scene.add_icosphere(
            MARK, radius=3 * self._current.scene.spacing, color=(255, 64, 64), position=place, opacity=0.6
        )
        self._note = f'Click the red ball: {found[0].reason}'
        for each in [client] if client is not None else self.server.get_clients().values():
            away = np.asarray(each.camera.position) - place
            distance = min(float(np.linalg.norm(away)), 60 * self._current.scene.spacing)
            each.camera.look_at = place
            each.camera.position = place + away / max(float(np.linalg.norm(away)), 1e-9) * distance
        self._told()

    def _save(self, client: Any) -> None:
        files = self.session.save(self._out)
        self._saved = 'saved: ' + ', '.join(str(path) for path in files)
        self._say(client, self._saved)
        self._told()

    def _choose(self, number: int, event: Any) -> None:
        if number < len(self.session.classes):
            self._class.value = self.session.classes[number]

    def _add_class(self, event: Any) -> None:
        self.session.add_class(self._new.value.strip(), '#{:02x}{:02x}{:02x}'.format(*self._color.value))
        self._class.options = self._names()
        self._class.value, self._new.value = self._new.value.strip(), ''
        self._changed()

    def _rename_class(self, event: Any) -> None:
        new = self._new.value.strip()
        self.session.rename_class(self._class_name(), new)
        self._class.options = self._names()
        self._class.value, self._new.value = new, ''
        self._changed()

    def _recolour(self, event: Any) -> None:
        self.session.add_class(self._class_name(), '#{:02x}{:02x}{:02x}'.format(*self._color.value))
        self._changed()

    def _class_name(self) -> str:
        return str(self._class.value)

    # ------------------------------------------------------------------ after an action

    def _changed(self) -> None:
        """Show the labels of the clicks that stand; the settled ones follow when nobody clicks."""
        self._labels = self.session.labels(self._name)
        self._note, self._estimate = '', 'estimate: when you pause'
        self._saved = 'every click is kept; the labels are not written yet: Save'
        if self._by.value in ('colour', 'intensity', 'height') and (self._labels.semantic != UNLABELLED).any():
            self._by.value = 'class'
        self._paint()
        self._dots()
        self._told()
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(SETTLE, self._guarded(lambda event: self._settle()), [None])
        self._timer.daemon = True
        self._timer.start()

    def _settle(self) -> None:
        if not (self._current.annotated >= 0).any():
            self._estimate = ''
        else:
            self._labels = self.session.settled(self._name)
            self._estimate = self._labels.remark()
            self._paint()
        self._told()

    def _joined(self, client: Any) -> None:
        if len(self.server.get_clients()) > 1:
            self._say(None, 'this page is open twice: both change one and the same session')

    def _say(self, client: Any, text: str, color: Literal['yellow', 'red'] = 'yellow') -> None:
        for each in [client] if client is not None else self.server.get_clients().values():
            each.add_notification('rm3d annotate', text, color=color, auto_close_seconds=8.0)

    def _guarded(self, act: Callable[[Any], None]) -> Callable[[Any], None]:
        """One action at a time; what a person can cause is said on the page, and nothing is lost."""

        def run(event: Any) -> None:
            with self._lock:
                try:
                    act(event)
                except (UserError, OSError) as error:
                    self._say(getattr(event, 'client', None), str(error), 'red')

        return run


def _of_client(act: Callable[[Any], None]) -> Callable[[Any], None]:
    """An action that is told who asked for it."""
    return lambda event: act(event.client)
