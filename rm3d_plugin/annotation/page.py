"""The page in a browser: a scan to look at and to click, its labels, and where the next click is worth most."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import viser

from rm3d_plugin.annotation.annotated_scan import AnnotatedScan
from rm3d_plugin.annotation.exchange_panel import ExchangePanel
from rm3d_plugin.annotation.lasso import Lasso
from rm3d_plugin.annotation.object_panel import ObjectPanel
from rm3d_plugin.annotation.scan_picture import ScanPicture
from rm3d_plugin.annotation.session import Session
from rm3d_plugin.annotation.status import FIRST_KEYS, status_of
from rm3d_plugin.annotation.suggestions import Suggestion
from rm3d_plugin.annotation.training_panel import TrainingPanel
from rm3d_plugin.annotation.view_panel import ViewPanel
from rm3d_plugin.inference.label_scan import LabelledScan
from rm3d_plugin.pseudo_labels.propagation.given_up import GivenUpError, given_up_if
from rm3d_plugin.user_error import UserError

Tool = Literal['point', 'region', 'lasso', 'eraser', 'accept region']
TOOLS: tuple[Tool, ...] = get_args(Tool)
SETTLE = 1.5  # seconds without an action, after which the labels are computed as they are written, with the estimate


class Outputs(NamedTuple):
    """Where things go, and how long is trained.

    Attributes:
        folder: For labels, boxes (``boxes/``) and trainings.
        minutes: Of a training.
        train: Train as soon as points of two classes are labelled.
        options: ``KEY=VALUE`` of the config of trainings.
    """

    folder: Path
    minutes: float = 20.0
    train: bool = False
    options: tuple[str, ...] = ()


class AnnotationPage:
    """A session shown in a browser; it runs until :meth:`stop`.

    Attributes:
        name: Of the scan that is shown.
        current: The scan.
        labels: What the clicks say of it.
        lock: Held by whoever acts, or shows something.

    Args:
        session: The scans and their clicks.
        out: Where what is saved goes.
        port: On this machine alone; others reach it through a tunnel.
    """

    def __init__(self, session: Session, out: Outputs, port: int = 8080) -> None:
        self.session, self._out, self._trains = session, out, out.train
        self.lock, self._settling = threading.RLock(), threading.Lock()
        self._timer: threading.Timer | None = None
        self._changes = 0  # of the labels, so far
        self._note, self._estimate, self._saved = '', '', 'nothing to save yet'
        self._doubts: list[Suggestion] | None = None  # labels that the others contradict; None: not looked for yet
        self._looked_at: set[tuple[str, int, int]] = set()  # labels that were shown to be checked: scan, point, class
        self.server = viser.ViserServer(host='127.0.0.1', port=port, label='rm3d annotate', verbose=False)
        self.server.scene.set_up_direction('+z')
        self.server.gui.configure_theme(dark_mode=True, show_logo=False)
        self.server.gui.main_panel.dock_right()
        self.picture = ScanPicture(self.server)
        self.lasso = Lasso(self.picture)
        self._controls()
        self.view = ViewPanel(self)
        self.objects = ObjectPanel(self, out.folder / 'boxes')
        self.training = TrainingPanel(self, out.folder, out.minutes, out.options)
        self.exchange = ExchangePanel(self, out.folder)
        self._keys()
        self.server.scene.on_click()(self.guarded(self._clicked))
        self.server.scene.on_rect_select(modifier='shift')(self.guarded(self._dragged))
        self.server.on_client_connect(self.guarded(self._joined))
        self._open(session.scans[0])
        self._train_if_asked()

    @property
    def url(self) -> str:
        """Where the page is."""
        return f'http://127.0.0.1:{self.server.get_port()}'

    def stop(self) -> None:
        """End it; every click is on the disk."""
        if self._timer is not None:
            self._timer.cancel()
        self._changes += 1  # nobody waits for labels that settle
        self.training.stop()
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
            gui.add_button('Add').on_click(self.guarded(self._add_class))
            gui.add_button('Rename').on_click(self.guarded(self._rename_class))
            gui.add_button('Set colour').on_click(self.guarded(self._recolour))
        for name, action in (
            ('Undo (ctrl z)', self._undo),
            ('Redo (ctrl shift z)', self._redo),
            ('Where to click next (space)', self._suggest),
            ('Check a label (c)', self._check),
            ('Save', self._save),
        ):
            gui.add_button(name).on_click(self.guarded(_of_client(action)))
        self._scan.on_update(self.guarded(lambda event: self._switch(self._scan.value)))

    def _keys(self) -> None:
        gui = self.server.gui
        for number, key in enumerate(FIRST_KEYS):
            command = gui.add_command(f'Class {number + 1}', hotkey=key)  # type: ignore[arg-type]
            command.on_trigger(self.guarded(partial(self._choose, number)))
        for label, key, modifier, act in (
            ('Undo', 'Z', 'cmd/ctrl', self._undo),
            ('Redo', 'Z', 'cmd/ctrl+shift', self._redo),
            ('Where to click next', 'space', None, self._suggest),
            ('Check a label', 'C', None, self._check),
            ('Close the lasso', 'enter', None, self._close_lasso),
        ):
            command = gui.add_command(label, hotkey=key, modifier=modifier)  # type: ignore[arg-type]
            command.on_trigger(self.guarded(_of_client(act)))

    def _open(self, name: str) -> None:
        """Show a scan."""
        self.current: AnnotatedScan = self.session.scan(name)
        self.name, self._note, self._estimate, self._doubts = name, '', '', None
        self.labels: LabelledScan = self.session.labels(name)
        self.view.opened()
        view = self.picture.overview()
        self.server.initial_camera.look_at = tuple(view.look_at)
        self.server.initial_camera.position = tuple(view.position)
        self.picture.forget_mark()
        self._marks()
        self._told()
        self.training.opened()

    def _switch(self, name: str) -> None:
        """Show another scan; where it cannot be read, the one that is shown stays chosen."""
        if name == self.name:
            return
        try:
            self._open(name)
        finally:
            self._scan.value = self.name

    def _marks(self) -> None:
        """Show clicks and boxes."""
        self.picture.show_clicked(self.current.annotated)
        self.objects.draw()

    def _told(self) -> None:
        """Counts, estimate, suggestion and whether all is saved."""
        lines = [line for line in (self._note, self._estimate, self._saved) if line]
        self._status.content = status_of(self.session, self.name, self.labels.semantic, lines)

    def _names(self) -> tuple[str, ...]:
        return self.session.classes or ('add a class first',)

    # ------------------------------------------------------------------ actions

    def _clicked(self, event: Any) -> None:
        if self._tool.value == 'lasso':
            if self.lasso.closed_by(event):
                self._close_lasso(event.client)
            return
        point = self.picture.met(event)
        if point is None:
            self.say(event.client, 'no point there: click on a point of the scan')
        elif self._tool.value == 'accept region':
            self.training.accept_region(point)
        elif self._tool.value == 'region':
            self.session.region(self.name, point, self._class_name(), self.objects.number)
            self.changed()
        else:
            self._label([point])

    def _dragged(self, event: Any) -> None:
        points = self.picture.in_rectangle(event)
        if points:
            self._label(points)
        else:
            self.say(event.client, 'no point in this rectangle')

    def _label(self, points: list[int]) -> None:
        """Label points by the class and the object that are chosen, or take their labels away."""
        if self._tool.value == 'eraser':
            self.session.erase(self.name, points)
        else:
            self.session.brush(self.name, points, self._class_name(), self.objects.number)
        self.changed()

    def _close_lasso(self, client: Any) -> None:
        """Label what lies in the polygon; the picture must not have moved meanwhile."""
        points = self.lasso.close(client)
        if points:
            self._label(points)
        else:
            self.say(client, 'no point in the lasso: click three corners or more, then enter, without moving the view')

    def _undo(self, client: Any) -> None:
        if not self.session.undo():
            self.say(client, 'nothing to undo')
        self.changed()

    def _redo(self, client: Any) -> None:
        if not self.session.redo():
            self.say(client, 'nothing to redo')
        self.changed()

    def _suggest(self, client: Any) -> None:
        """Look at the place whose label would tell most."""
        found = self.session.suggest(self.name)
        if not found:
            self.say(client, 'every place was suggested')
            return
        self._show(client, found[0].point, f'Click the red ball: {found[0].reason}')

    def _check(self, client: Any) -> None:
        """Look at the label that the others contradict most, of those that nobody looked at."""
        annotated, doubts = self.current.annotated, self._doubts
        if doubts is None:
            self._note = 'checking every label by the others ...'
            self._told()
            doubts = self._doubts = self.session.contradicted(self.name)
            self._note = ''
        for each in doubts:
            label = (self.name, each.point, int(annotated[each.point]))
            if label not in self._looked_at:
                self._looked_at.add(label)
                self._show(client, each.point, f'Is the red ball right? It is {each.reason}')
                return
        self._told()
        self.say(client, 'no label is left that the others contradict')

    def _show(self, client: Any, point: int, note: str) -> None:
        """Mark a point, look at it, and say why."""
        self.picture.mark(point)
        self._note = note
        for each in [client] if client is not None else self.server.get_clients().values():
            self.picture.look_at(each, point)
        self._told()

    def _save(self, client: Any) -> None:
        before, self._saved = self._saved, 'saving ...'
        self._told()
        try:
            files = self.session.save(self._out.folder)
            self._saved = 'saved: ' + ', '.join(str(path) for path in files)
        except (UserError, OSError):
            self._saved = before
            raise
        finally:
            self._told()
        self.say(client, self._saved)

    def _choose(self, number: int, event: Any) -> None:
        if number < len(self.session.classes):
            self._class.value = self.session.classes[number]

    def _add_class(self, event: Any) -> None:
        name = self._new.value.strip()
        self.session.add_class(name, '#{:02x}{:02x}{:02x}'.format(*self._color.value))
        self.classes_changed(name)

    def _rename_class(self, event: Any) -> None:
        new = self._new.value.strip()
        self.session.rename_class(self._class_name(), new)
        self.classes_changed(new)

    def _recolour(self, event: Any) -> None:
        self.session.add_class(self._class_name(), '#{:02x}{:02x}{:02x}'.format(*self._color.value))
        self.changed()

    def classes_changed(self, chosen: str | None = None) -> None:
        """Show the classes anew.

        Args:
            chosen: That is chosen from now on; None: as before.
        """
        before = self._class_name()
        self._class.options = self._names()
        self._class.value = chosen or (before if before in self._names() else self._names()[0])
        self._new.value = ''
        self.changed()

    def _class_name(self) -> str:
        return str(self._class.value)

    # ------------------------------------------------------------------ after an action

    def changed(self) -> None:
        """Show the labels of the clicks that stand; the settled ones follow when nobody clicks."""
        self._changes += 1  # labels that are being settled are given up, and do not slow this down
        self.labels, self._doubts = self.session.labels(self.name), None
        self._note, self._estimate = '', 'estimate: when you pause'
        self._saved = 'every click is kept; the labels are not written yet: Save'
        self.view.show_labels()
        self._marks()
        self._told()
        self._settle_in(SETTLE)

    def _settle_in(self, seconds: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(seconds, self._settle)
        self._timer.daemon = True
        self._timer.start()

    def _settle(self) -> None:
        """Show the labels as they are written; they are computed beside clicks, and given up where one came first."""
        with self._settling, self._saying(None), contextlib.suppress(GivenUpError):
            with self.lock:
                name, shown, labelled = self.name, self.labels, (self.current.annotated >= 0).any()
                changes = self._changes
            with given_up_if(lambda: self._changes != changes or self.name != name):
                found = self.session.settled(name) if labelled else shown
            with self.lock:
                if self.labels is shown:
                    self.labels, self._estimate = found, found.remark() if labelled else ''
                    self.view.paint()
                    self._told()
                    self._train_if_asked()
            self.view.compare()

    def _train_if_asked(self) -> None:
        """Start the training of ``--train``, once, as soon as there are labels of two classes."""
        annotated = self.current.annotated
        if self._trains and np.unique(annotated[annotated >= 0]).size > 1:
            self._trains = False
            self.training.start()

    def _joined(self, client: Any) -> None:
        if len(self.server.get_clients()) > 1:
            self.say(None, 'this page is open twice: both change one and the same session')

    def say(self, client: Any, text: str, color: Literal['yellow', 'red'] = 'yellow') -> None:
        """Show a message to a client, None: to all."""
        for each in [client] if client is not None else self.server.get_clients().values():
            each.add_notification('rm3d annotate', text, color=color, auto_close_seconds=8.0)

    def guarded(self, act: Callable[[Any], None]) -> Callable[[Any], None]:
        """One action at a time; what a person can cause is said on the page, and nothing is lost."""

        def run(event: Any) -> None:
            with self.lock, self._saying(getattr(event, 'client', None)):
                act(event)

        return run

    def beside(self, act: Callable[[], None]) -> Callable[[], None]:
        """Work beside actions; what goes wrong is said to all."""

        def run() -> None:
            with self._saying(None):
                act()

        return run

    @contextlib.contextmanager
    def _saying(self, client: Any) -> Iterator[None]:
        try:
            yield
        except (UserError, OSError) as error:
            self.say(client, str(error), 'red')


def _of_client(act: Callable[[Any], None]) -> Callable[[Any], None]:
    """An action that is told who asked for it."""
    return lambda event: act(event.client)
