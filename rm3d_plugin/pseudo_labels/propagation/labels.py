"""The labels that an answer starts from."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


class Labels(NamedTuple):
    """What is given of the points of a scan and of other scans.

    Attributes:
        points: (L,) with a label, each once.
        classes: (L,) of each, from 0 to ``num_classes`` - 1.
        num_classes: How many; those without a label get what others say for them.
        others: (E, F) features of labelled points of other scans.
        other_classes: (E,) of these.
    """

    points: Int[np.ndarray, ' labelled']
    classes: Int[np.ndarray, ' labelled']
    num_classes: int
    others: Float[np.ndarray, 'examples features']
    other_classes: Int[np.ndarray, ' examples']

    def select(self, rows: Bool[np.ndarray, ' labelled']) -> 'Labels':
        """Some of the labels, and all others."""
        return self._replace(points=self.points[rows], classes=self.classes[rows])
