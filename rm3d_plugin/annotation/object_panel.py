"""Objects on the page: which one clicks belong to, its box, and handles that correct it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.colors import to_rgb
from viser.transforms import SO3

from rm3d_plugin.annotation.box_exchange import export_boxes, import_boxes
from rm3d_plugin.annotation.objects import Objects
from rm3d_plugin.datasets.box_formats import BOX_FORMATS
from rm3d_plugin.structures import SceneError

if TYPE_CHECKING:
    from rm3d_plugin.annotation.page import AnnotationPage

NONE = 'none'
CHOSEN = (255, 255, 0)
HANDLES = 1.5  # length of the handles, times half the length of the box


class ObjectPanel:
    """The folder *Objects* of the page.

    Args:
        page: Whose.
        out: Folder for exported boxes.
    """

    def __init__(self, page: 'AnnotationPage', out: Path) -> None:
        self._page, self._out = page, out
        self._handles: Any = None
        gui, guarded = page.server.gui, page.guarded
        with gui.add_folder('Objects', expand_by_default=False):
            self._object: Any = gui.add_dropdown('Object', (NONE,), hint='clicks belong to it; its box has handles')
            gui.add_button('New object (n)').on_click(guarded(self.begin))
            gui.add_button('Fit a box (b)').on_click(guarded(self.fit))
            gui.add_button('Remove the box').on_click(guarded(self._remove))
            self._size: Any = gui.add_vector3('Size, m', (1.0, 1.0, 1.0), min=(0.01,) * 3, step=0.05)
            self._format: Any = gui.add_dropdown('Format', tuple(BOX_FORMATS))
            gui.add_button('Export boxes').on_click(guarded(self._export))
            self._file: Any = gui.add_text('File of boxes', '')
            gui.add_button('Import boxes').on_click(guarded(self._import))
        self._object.on_update(guarded(lambda event: self.draw()))
        self._size.on_update(guarded(self._resized))
        for label, key, act in (('New object', 'N', self.begin), ('Fit a box', 'B', self.fit)):
            gui.add_command(label, hotkey=key).on_trigger(guarded(act))  # type: ignore[arg-type]

    @property
    def _objects(self) -> Objects:
        return self._page.session.objects

    @property
    def number(self) -> int:
        """Of the object that clicks belong to, -1 = none."""
        word = str(self._object.value).partition(':')[0]
        return -1 if word == NONE else int(word)

    def begin(self, event: Any) -> None:
        """Let the next clicks be of a new object."""
        self._choose(self._objects.next_number(self._page.name))

    def fit(self, event: Any) -> None:
        """Put a box around the object that is chosen."""
        self._objects.fit(self._page.name, self._chosen())
        self.draw()

    def _remove(self, event: Any) -> None:
        self._objects.remove_box(self._page.name, self._chosen())
        self.draw()

    def _export(self, event: Any) -> None:
        files = export_boxes(self._page.session, self._out, self._format.value)
        self._page.say(event.client, f'{len(files)} files of boxes in {self._out}')

    def _import(self, event: Any) -> None:
        path = Path(str(self._file.value).strip())
        if not path.is_file():
            raise SceneError(f'{path}: no such file of boxes')
        numbers = import_boxes(self._objects, self._page.name, [path])
        self._page.classes_changed()
        self._page.say(event.client, f'{len(numbers)} boxes of {path.name}')

    def _chosen(self) -> int:
        if self.number < 0:
            raise SceneError('choose an object first, or begin one: key n')
        return self.number

    # ------------------------------------------------------------------ what is seen

    def draw(self) -> None:
        """Show the boxes, and handles on that of the chosen object."""
        self._list(self.number)
        rows = {number: self._local(box.row) for number, box in self._objects.boxes(self._page.name).items()}
        colors = {number: self._color(number) for number in rows}
        self._page.picture.show_boxes(rows, colors)
        if self._handles is not None:
            self._handles.remove()
            self._handles = None
        if self.number in rows:
            self._size.value = tuple(rows[self.number][3:6].tolist())
            self._add_handles(rows[self.number])

    def _choose(self, number: int) -> None:
        self._list(number)
        self.draw()

    def _list(self, number: int) -> None:
        """Name the objects there are, and the chosen one."""
        listed, classes = self._objects.listed(self._page.name), self._page.session.classes
        names = {each: f'{each}: {classes[found.semantic]}' for each, found in listed.items()}
        if number >= 0:
            names.setdefault(number, f'{number}: new')
        wanted, options = names.get(number, NONE), (NONE, *(names[each] for each in sorted(names)))
        if self._object.options != options:
            self._object.options = options
        if self._object.value != wanted:
            self._object.value = wanted

    def _color(self, number: int) -> tuple[int, int, int]:
        if number == self.number:
            return CHOSEN
        box = self._objects.boxes(self._page.name)[number]
        red, green, blue = to_rgb(self._page.session.color(self._page.session.classes[box.semantic]))
        return int(255 * red), int(255 * green), int(255 * blue)

    def _add_handles(self, row: Float[np.ndarray, '7']) -> None:
        turn = SO3.from_z_radians(float(row[6])).wxyz
        upright = ((0.0, 0.0), (0.0, 0.0), (-1000.0, 1000.0))
        self._handles = self._page.server.scene.add_transform_controls(
            'handles', scale=HANDLES * max(float(row[3:6].max()) / 2, 0.1), rotation_limits=upright, depth_test=False,
            wxyz=turn, position=row[:3],
        )  # fmt: skip
        self._handles.on_update(self._page.guarded(self._moved))

    def _moved(self, event: Any) -> None:
        """A handle was let go."""
        if event.phase != 'end':
            return
        box = self._objects.boxes(self._page.name)[self._chosen()]
        forward = SO3(np.asarray(event.target.wxyz)).as_matrix()[:, 0]
        place = np.asarray(event.target.position, dtype=np.float64) + self._origin
        row = np.array([*place, *box.row[3:6], np.arctan2(forward[1], forward[0])])
        self._objects.set_box(self._page.name, box.instance, row)
        self.draw()

    def _resized(self, event: Any) -> None:
        box = self._objects.boxes(self._page.name).get(self.number)
        if box is None or np.allclose(box.row[3:6], self._size.value, atol=1e-4):
            return
        bottom = box.row[2] - box.row[5] / 2  # it stays on the ground
        size = np.asarray(self._size.value, dtype=np.float64)
        row = np.array([*box.row[:2], bottom + size[2] / 2, *size, box.row[6]])
        self._objects.set_box(self._page.name, box.instance, row)
        self.draw()

    @property
    def _origin(self) -> Float[np.ndarray, '3']:
        return np.asarray(self._page.session.scan(self._page.name).cloud.origin, dtype=np.float64)

    def _local(self, row: tuple[float, ...]) -> Float[np.ndarray, '7']:
        local = np.array(row)
        local[:3] -= self._origin
        return local
