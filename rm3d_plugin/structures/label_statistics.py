"""What the annotated labels of a training set say as a whole."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class LabelStatistics:
    """What a label maker tells a model at the start of training and of each round.

    Attributes:
        class_counts: (C,) annotated labels of each class: points in segmentation, boxes in detection.
        mean_sizes: (C, 3) length, width and height of each class in metres; None where they are not known for every
            class, as in segmentation.
        judged: Whether the labels in use heard what a network or the shape of things says, so that what is unknown in
            them is doubtful, and not likely background.

    Raises:
        ValueError: A count is negative, a size is not a positive length, or both speak of different classes.
    """

    class_counts: Int[np.ndarray, ' classes']
    mean_sizes: Float[np.ndarray, 'classes 3'] | None = None
    judged: bool = False

    def __post_init__(self) -> None:
        if self.class_counts.ndim != 1 or (self.class_counts < 0).any():
            raise ValueError(f'LabelStatistics.class_counts: expected (C,) from 0, got {self.class_counts.tolist()}')
        if self.mean_sizes is None:
            return
        if self.mean_sizes.shape != (len(self.class_counts), 3):
            raise ValueError(
                f'LabelStatistics.mean_sizes: expected ({len(self.class_counts)}, 3), one row a class, got '
                f'{self.mean_sizes.shape}'
            )
        if not (np.isfinite(self.mean_sizes) & (self.mean_sizes > 0)).all():
            raise ValueError(
                f'LabelStatistics.mean_sizes: expected positive metres, got {self.mean_sizes.tolist()}; give None '
                'where a class has no size'
            )
