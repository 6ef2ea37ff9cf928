"""Boxes under the names of their classes, as files hold them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.class_names import class_index
from rm3d_plugin.structures import Boxes3D, SceneError

SIZES = ('length', 'width', 'height')


class BoxFileError(SceneError):
    """Boxes that cannot be read; the message names file, object and field, and what to do."""


class NamedBoxes(NamedTuple):
    """Boxes with the names of their classes.

    Attributes:
        names: Class of each box.
        tensor: (M, 7) float64 rows as :class:`~rm3d_plugin.structures.Boxes3D`.
        scores: (M,) in [0, 1], or None where the file has none.
    """

    names: list[str]
    tensor: Float[np.ndarray, 'boxes 7']
    scores: Float[np.ndarray, ' boxes'] | None = None

    def of_classes(self, classes: Sequence[str]) -> Boxes3D:
        """The boxes of these classes, letter case aside, with their numbers; others are left out."""
        numbers = [class_index(name, classes) for name in self.names]
        kept = [row for row, number in enumerate(numbers) if number is not None]
        labels = np.array([numbers[row] for row in kept], dtype=np.int64)
        return Boxes3D(self.tensor[kept], labels, None if self.scores is None else self.scores[kept])

    @classmethod
    def from_boxes(cls, boxes: Boxes3D, classes: Sequence[str]) -> 'NamedBoxes':
        """The same boxes under the names of their classes."""
        return cls([classes[label] for label in boxes.labels.tolist()], boxes.tensor, boxes.scores)
