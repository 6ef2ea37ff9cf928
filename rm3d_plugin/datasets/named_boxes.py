"""Boxes under the names of their classes, as files hold them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

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
        numbers = {name.lower(): number for number, name in reversed(list(enumerate(classes)))}
        kept = [row for row, name in enumerate(self.names) if name.lower() in numbers]
        labels = np.array([numbers[self.names[row].lower()] for row in kept], dtype=np.int64)
        return Boxes3D(self.tensor[kept], labels, None if self.scores is None else self.scores[kept])

    @classmethod
    def from_boxes(cls, boxes: Boxes3D, classes: Sequence[str]) -> 'NamedBoxes':
        """The same boxes under the names of their classes."""
        return cls([classes[label] for label in boxes.labels.tolist()], boxes.tensor, boxes.scores)
