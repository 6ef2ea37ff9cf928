"""The box of an object, as a log of clicks holds it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rm3d_plugin.storage.clicks import DECIMALS, ClickFileError, class_number, takes_away
from rm3d_plugin.structures import UNLABELLED

ANGLE_DECIMALS = 6  # of a radian
LENGTHS = {'center': 3, 'size': 3}  # fields of a line, and how many numbers each holds


@dataclass(frozen=True)
class InstanceBox:
    """The box of an object from now on, or that it has none any more.

    Attributes:
        scene: Name of its scene.
        instance: Number of the object, from 0.
        semantic: Class number; -1: the object has no box.
        row: Middle, length, width, height (metres, in the coordinates of the original file, z up) and yaw (radians,
            counter-clockwise from x); zeros where there is no box.

    Raises:
        ClickFileError: A number is not finite, a size not above 0, or the object has no number.
    """

    scene: str
    instance: int
    semantic: int
    row: tuple[float, ...] = (0.0,) * 7

    def __post_init__(self) -> None:
        where = f'box of object {self.instance} in scene {self.scene}'
        if self.instance < 0:
            raise ClickFileError(f'{where}: expected the number of an object, 0 or more')
        if len(self.row) != 7 or not all(map(math.isfinite, self.row)):
            raise ClickFileError(f'{where}: expected seven finite numbers, got {self.row}')
        if self.semantic != UNLABELLED and min(self.row[3:6]) <= 0:
            raise ClickFileError(f'{where}: size: expected lengths above 0 m, got {self.row[3:6]}')

    @classmethod
    def at(cls, scene: str, instance: int, semantic: int, row: Float[np.ndarray, '7']) -> 'InstanceBox':
        """A box whose numbers are rounded as the log holds them."""
        digits = [DECIMALS] * 6 + [ANGLE_DECIMALS]
        rounded = (round(float(value), places) for value, places in zip(row, digits, strict=True))
        return cls(scene, instance, semantic, tuple(rounded))


def row_of_box(box: InstanceBox, classes: Sequence[str]) -> dict[str, Any]:
    """The fields of a box by their names in a log.

    Raises:
        ClickFileError: Its class is not among ``classes``.
    """
    if not UNLABELLED <= box.semantic < len(classes):
        raise ClickFileError(f'box: class: expected a number 0..{len(classes) - 1}, got {box.semantic}')
    head = {'scene': box.scene, 'instance': box.instance}
    if box.semantic == UNLABELLED:
        return {**head, 'class': None}
    place = {'center': list(box.row[:3]), 'size': list(box.row[3:6]), 'yaw': box.row[6]}
    return {**head, 'class': classes[box.semantic], **place}


def box_from_row(where: str, row: Mapping[str, Any], classes: Sequence[str]) -> InstanceBox:
    """The box of named fields.

    Args:
        where: File and line, for error messages.
        row: Field -> text or number.
        classes: Class names.

    Raises:
        ClickFileError: A field is missing or cannot be used.
    """
    scene, instance = row.get('scene'), row.get('instance')
    if not isinstance(scene, str) or type(instance) is not int:
        raise ClickFileError(f'{where}: expected scene and instance of a box, got {scene!r}, {instance!r}')
    if takes_away(row):
        return InstanceBox(scene, instance, UNLABELLED)
    numbers = [row.get(name) for name in LENGTHS]
    lists = all(isinstance(each, list) and len(each) == 3 for each in numbers)
    values = [*(numbers[0] or ()), *(numbers[1] or ()), row.get('yaw')] if lists else []
    if not values or not all(type(value) in (int, float) for value in values):
        raise ClickFileError(f'{where}: expected center and size of three numbers each, and yaw; mend or delete it')
    semantic = class_number(where, str(row.get('class') or ''), classes)
    return InstanceBox(scene, instance, semantic, tuple(map(float, values)))
