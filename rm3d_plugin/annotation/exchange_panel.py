"""Labels of other programs on the page, and clicks for them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rm3d_plugin.structures import SceneError

if TYPE_CHECKING:
    from rm3d_plugin.annotation.page import AnnotationPage

CLICKS = ('.csv', '.json', '.jsonl')
EXPORTED = 'clicks.csv'


class ExchangePanel:
    """The folder *Exchange* of the page.

    Args:
        page: Whose.
        out: Folder for exported clicks.
    """

    def __init__(self, page: 'AnnotationPage', out: Path) -> None:
        self._page, self._out = page, out
        gui, guarded = page.server.gui, page.guarded
        with gui.add_folder('Exchange', expand_by_default=False):
            self._file: Any = gui.add_text(
                'File', '', hint='clicks (.csv .json .jsonl), or a scan with labels of the points that are shown'
            )
            self._field: Any = gui.add_text('Field', 'label', hint='of a scan: where its labels are')
            gui.add_button('Import labels').on_click(guarded(self._import))
            gui.add_button('Export clicks').on_click(guarded(self._export))

    def _import(self, event: Any) -> None:
        path, session = Path(str(self._file.value).strip()).expanduser(), self._page.session
        if not path.is_file():
            raise SceneError(f'{path}: no such file of labels; looked for at {path.absolute()}')
        if path.suffix.lower() in CLICKS:
            count = session.import_clicks(path)
        else:
            count = session.import_labels(self._page.name, path, str(self._field.value).strip())
        self._page.classes_changed()
        self._page.say(event.client, f'{count} labels of {path.name} (undo takes them back)')

    def _export(self, event: Any) -> None:
        path = self._page.session.export_clicks(self._out / EXPORTED)
        self._page.say(event.client, f'{path}: the clicks that stand, of all scans')
