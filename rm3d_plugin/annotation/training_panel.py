"""Training on the page: a process beside it, and its labels as a difference that is accepted in parts."""

import html
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rm3d_plugin.annotation.training import Difference, Training, TrainingPlan, accept
from rm3d_plugin.structures import SceneError

if TYPE_CHECKING:
    from rm3d_plugin.annotation.page import AnnotationPage

LOOK = 2.0  # seconds between looks at the process
ALL = 'all classes'
NO_SAY = 'clicks that the network was not taught do not speak for it: these are the labels without it'


class TrainingPanel:
    """The folder *Training* of the page.

    Args:
        page: Whose.
        out: Folder; trainings come into ``trained_1`` and so on.
        minutes: Of a training, at first.
        options: ``KEY=VALUE`` of the config of trainings.
    """

    def __init__(self, page: 'AnnotationPage', out: Path, minutes: float, options: tuple[str, ...] = ()) -> None:
        self._page, self._out, self._options = page, out, options
        self._training: Training | None = None
        self._timer: threading.Timer | None = None
        self._found: dict[str, Difference] = {}
        gui, guarded = page.server.gui, page.guarded
        with gui.add_folder('Training', expand_by_default=False):
            self._minutes: Any = gui.add_number('Minutes', minutes, min=0.5, step=0.5)
            gui.add_button('Train').on_click(guarded(lambda event: self.start()))
            gui.add_button('Stop').on_click(guarded(lambda event: self.stop()))
            self._bar: Any = gui.add_progress_bar(0.0, visible=False)
            self._told: Any = gui.add_html('')
            self._class: Any = gui.add_dropdown('Changes to', (ALL,), hint='tool "accept region": click to accept')
            gui.add_button('Accept').on_click(guarded(self._accept))

    @property
    def running(self) -> bool:
        """Whether a process trains."""
        return self._training is not None and self._training.running

    def start(self) -> None:
        """Train on the labels of now.

        Raises:
            SceneError: A training runs, or labels of two classes are needed.
        """
        if self.running:
            raise SceneError('a training runs already: stop it first')
        taken = sum(1 for path in self._out.glob('trained_*')) if self._out.is_dir() else 0
        plan = TrainingPlan(self._out / f'trained_{taken + 1}', float(self._minutes.value), self._options)
        self._training, self._found = Training(self._page.session, plan), {}
        self._bar.visible = True
        self._look()

    def stop(self) -> None:
        """End the training, and no longer look at it."""
        if self._timer is not None:
            self._timer.cancel()
        if self._training is not None:
            self._training.stop()
            self._say(self._training.told())

    def difference(self) -> Difference | None:
        """What the last training would change in the scan that is shown, as long as it is not labelled."""
        found = self._found.get(self._page.name)
        if found is None:
            return None
        annotated = self._page.session.scan(self._page.name).annotated
        return found._replace(semantic=np.where(annotated < 0, found.semantic, -1))

    def accept_region(self, point: int) -> None:
        """Take over what would change in the region of a point."""
        region = self._page.session.scan(self._page.name).region
        self._take(region == region[point])

    def _accept(self, event: Any) -> None:
        chosen = str(self._class.value).rpartition(': ')[0]
        semantic = self._difference().semantic
        session = self._page.session
        self._take(semantic == session.class_number(chosen) if chosen else semantic >= 0)

    def _take(self, chosen: np.ndarray) -> None:
        count = accept(self._page.session, self._page.name, self._difference(), chosen)
        self._page.changed()
        self._say(f'{count} points accepted (undo takes them back)')
        self._list()

    def _difference(self) -> Difference:
        found = self.difference()
        if found is None:
            raise SceneError('there is nothing to accept: train first, and wait until it is done')
        return found

    # ------------------------------------------------------------------ the process

    def _look(self) -> None:
        """Say how far it is; when it is done, show what it would change."""
        training = self._training
        if training is None:
            return
        self._bar.value = 100 * training.progress
        self._say(training.told())
        if training.running:
            self._timer = threading.Timer(LOOK, self._page.guarded(lambda event: self._look()), [None])
            self._timer.daemon = True
            self._timer.start()
        else:
            self._bar.visible = False
            self._show(training)

    def opened(self) -> None:
        """Compare where another scan is shown that the last training has labels of."""
        if self._training is not None and self._training.labelled(self._page.name):
            self._show(self._training)

    def _show(self, training: Training) -> None:
        """Compare the labels of a training with those of now in the scan that is shown."""
        found = training.difference(self._page.name)
        self._found[self._page.name] = found
        changes = int((found.semantic >= 0).sum())
        self._say(f'{"" if found.heard else NO_SAY + "; "}{changes} points would change')
        self._list()
        self._page.view.show('difference')

    def _list(self) -> None:
        session, found = self._page.session, self._difference()
        counts = zip(session.classes, found.counts(len(session.classes)).tolist(), strict=True)
        self._class.options = (ALL, *(f'{name}: {count}' for name, count in counts if count))
        self._class.value = ALL

    def _say(self, text: str) -> None:
        self._told.content = f'<p style="padding:0 0.6em">{html.escape(text)}</p>'
