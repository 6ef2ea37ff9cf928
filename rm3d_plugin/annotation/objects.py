"""Objects of a session: clicks that belong together, and a box around them."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.annotation.click_log import Action
from rm3d_plugin.annotation.object_fit import WHOLE, fit_object_box
from rm3d_plugin.datasets.named_boxes import NamedBoxes
from rm3d_plugin.storage import InstanceBox
from rm3d_plugin.structures import UNLABELLED, SceneError

if TYPE_CHECKING:
    from rm3d_plugin.annotation.session import Session


class ObjectSummary(NamedTuple):
    """An object, as it is listed.

    Attributes:
        semantic: Class of most of its clicked points, of its box where none is clicked.
        clicked: Points.
        box: None: it has none.
    """

    semantic: int
    clicked: int
    box: InstanceBox | None


class Objects:
    """Objects of the scans of a session; every change is an action of the session, in its log.

    An object is a number of its scan: ``session.click(scan, point, name, instance)`` gives it a point.

    Args:
        session: Whose.
    """

    def __init__(self, session: 'Session') -> None:
        self._session = session

    def listed(self, scan: str) -> dict[int, ObjectSummary]:
        """The objects of a scan by number, ascending.

        Raises:
            SceneError: There is no such scan, or it cannot be read.
        """
        marks, boxes = self._session.scan(scan), self.boxes(scan)
        clicked = {number: marks.annotated[marks.instance == number] for number in np.unique(marks.instance).tolist()}
        clicked.pop(-1, None)
        out = {}
        for number in sorted(clicked.keys() | boxes.keys()):
            classes, box = clicked.get(number, np.zeros(0, np.int64)), boxes.get(number)
            most = int(np.bincount(classes).argmax()) if len(classes) else box.semantic if box else UNLABELLED
            out[number] = ObjectSummary(most, len(classes), box)
        return out

    def boxes(self, scan: str) -> dict[int, InstanceBox]:
        """The box of each object that has one, by number of the object, in the coordinates of the file."""
        return self._session.log.boxes(scan)

    def next_number(self, scan: str) -> int:
        """The first number that no object of a scan has, or had before it was erased in this log."""
        used = [click.instance for click in self._session.log.actions(scan)]
        return max([*used, *self.boxes(scan), -1]) + 1

    def points(self, scan: str, number: int) -> Int[np.ndarray, ' inside']:
        """Points of an object, those between its clicks among them; numbers in the file.

        Raises:
            SceneError: It has no click, or nearly all of the scan seems to be of it.
        """
        marks, name = self._session.scan(scan), self._class_of(scan, number)
        may_be = self._session.labels(scan).semantic == name
        size = self.usual_size(name)
        if size is not None:
            xyz = marks.cloud.xyz
            away = xyz - xyz[marks.instance == number].mean(axis=0)
            may_be &= np.linalg.norm(away, axis=1) <= np.linalg.norm(size)
        found = marks.object_points(may_be, number)
        if len(found) > WHOLE * len(marks.cloud):
            raise SceneError(
                f'scan {scan}, object {number}: {len(found)} of {len(marks.cloud)} points seem to belong to it; label '
                'what is around it with another class first'
            )
        return found

    def fit(self, scan: str, number: int) -> InstanceBox:
        """Put a box around an object, in place of the one it had.

        Raises:
            SceneError: See :meth:`points`.
            ClickFileError: The line cannot be written.
        """
        points, cloud = self.points(scan, number), self._session.scan(scan).cloud
        name = self._class_of(scan, number)
        sensor = None if cloud.sensor is None else (float(cloud.sensor[0]), float(cloud.sensor[1]))
        row = fit_object_box(cloud.xyz[points].astype(np.float64), self.usual_size(name), sensor)
        row[:3] += np.asarray(cloud.origin)
        return self._set(InstanceBox.at(scan, number, name, row))

    def set_box(self, scan: str, number: int, row: Float[np.ndarray, '7'], name: str | None = None) -> InstanceBox:
        """Put a box where a person says.

        Args:
            scan: Name of the scan.
            number: Of the object.
            row: As :class:`~rm3d_plugin.structures.Boxes3D`, in the coordinates of the file.
            name: Of the class; None: that of the object.

        Raises:
            SceneError: There is no such scan or object, or the class is not known.
            ClickFileError: The row is no box, or the line cannot be written.
        """
        semantic = self._class_of(scan, number) if name is None else self._session.class_number(name)
        return self._set(InstanceBox.at(scan, number, semantic, row))

    def remove_box(self, scan: str, number: int) -> None:
        """Take the box of an object away; its clicks stay.

        Raises:
            SceneError: It has none.
        """
        if number not in self.boxes(scan):
            raise SceneError(f'scan {scan}: object {number} has no box')
        self._set(InstanceBox(scan, number, UNLABELLED))

    def add_boxes(self, scan: str, boxes: NamedBoxes) -> list[int]:
        """Take over boxes of another program, one action; classes that are new are added. Returns their numbers.

        Args:
            scan: Name of the scan.
            boxes: In the coordinates of its file; scores are dropped.
        """
        self._session.scan(scan)
        for name in dict.fromkeys(boxes.names):
            if name not in self._session.classes:
                self._session.add_class(name)
        first = self.next_number(scan)
        numbers = list(range(first, first + len(boxes.names)))
        found = [
            InstanceBox.at(scan, number, self._session.class_number(name), row)
            for number, name, row in zip(numbers, boxes.names, boxes.tensor, strict=True)
        ]
        if found:
            self._session.act(Action(boxes=found))
        return numbers

    def named(self, scan: str) -> NamedBoxes:
        """The boxes of a scan under the names of their classes."""
        boxes, classes = list(self.boxes(scan).values()), self._session.classes
        rows = np.array([box.row for box in boxes], dtype=np.float64).reshape(-1, 7)
        return NamedBoxes([classes[box.semantic] for box in boxes], rows)

    def usual_size(self, semantic: int) -> Float[np.ndarray, '3'] | None:
        """Median length, width and height of the boxes of a class in all scans; None before the first."""
        every = [box.row[3:6] for scan in self._session.scans for box in self.boxes(scan).values()
                 if box.semantic == semantic]  # fmt: skip
        return np.median(np.array(every), axis=0) if every else None

    def _class_of(self, scan: str, number: int) -> int:
        found = self.listed(scan).get(number)
        if found is None:
            raise SceneError(f'scan {scan}: there is no object {number}: give it a point first')
        return found.semantic

    def _set(self, box: InstanceBox) -> InstanceBox:
        self._session.act(Action(boxes=[box]))
        return box
