"""How a scan is shown on the page: which of its points, and in which colours."""

import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rm3d_plugin.annotation.point_view import COLOR_BY, SHOWN, ColorBy, colors_by
from rm3d_plugin.structures import UNLABELLED

if TYPE_CHECKING:
    from rm3d_plugin.annotation.page import AnnotationPage

WITHOUT_LABELS = ('colour', 'intensity', 'height')


class ViewPanel:
    """The folder *View* of the page.

    Args:
        page: Whose.
    """

    def __init__(self, page: 'AnnotationPage') -> None:
        self._page = page
        self._agreement = np.zeros(0)
        gui, guarded = page.server.gui, page.guarded
        with gui.add_folder('View'):
            self.by: Any = gui.add_dropdown('Colour by', COLOR_BY, initial_value='colour')
            self._size: Any = gui.add_slider('Point size', 0.25, 4.0, 0.25, 1.0)
            self.most: Any = gui.add_slider(
                'Points, thousands', 25, SHOWN // 1000, 25, SHOWN // 1000, hint='fewer: faster without a GPU'
            )
            self._heights: Any = gui.add_multi_slider('Heights, %', 0, 100, 1, (0, 100))
        self.by.on_update(guarded(lambda event: self._chosen()))
        for control in (self._size, self.most, self._heights):
            control.on_update(guarded(lambda event: self.draw()))

    def draw(self) -> None:
        """Send the points that are shown."""
        most, size = int(1000 * self.most.value), float(self._size.value)
        self._page.picture.show(self._page.current, size, self._heights.value, most)
        self.paint()

    def paint(self) -> None:
        """Send colours."""
        page, kind = self._page, self._kind
        colors = [page.session.color(name) for name in page.session.classes]
        shown, labels, found = page.picture.shown, page.labels, page.training.difference()
        semantic, sure = labels.semantic[shown], labels.confidence[shown]
        if kind == 'difference':
            semantic = np.full(len(shown), UNLABELLED) if found is None else found.semantic[shown]
        if kind == 'check':
            whole = len(self._agreement) == len(labels.semantic)
            sure = self._agreement[shown] if whole else np.full(len(shown), np.nan)
        seen = replace(labels, semantic=semantic, confidence=sure, region=labels.region[shown])
        page.picture.paint(colors_by(kind, page.current.cloud.select(shown), seen, colors))

    def show(self, kind: ColorBy) -> None:
        """Colour by something else."""
        self.by.value = kind
        self.paint()

    def show_labels(self) -> None:
        """Send colours; those of the classes from the first label on."""
        if self._kind in WITHOUT_LABELS and (self._page.labels.semantic != UNLABELLED).any():
            self.by.value = 'class'
        self.paint()

    def opened(self) -> None:
        """Show another scan."""
        self._agreement = np.zeros(0)
        self.draw()

    def compare(self) -> None:
        """Ask the other labels about each, beside clicks, where that is what the colours tell."""
        if self._kind != 'check':
            return
        name, agreement = self._page.name, self._page.session.agreement(self._page.name)
        with self._page.lock:
            if name == self._page.name:
                self._agreement = agreement
                self.paint()

    @property
    def _kind(self) -> ColorBy:
        kind: ColorBy = self.by.value
        return kind

    def _chosen(self) -> None:
        self.paint()
        threading.Thread(target=self._page.beside(self.compare), daemon=True).start()
