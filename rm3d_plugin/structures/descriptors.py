"""What a descriptor provider hands back."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Descriptors:
    """One feature vector a point.

    They are the largest array of a scene (500 bytes a point), so a selection shares them: what meets all points of a
    large scene reads ``source[rows]`` in parts, and nobody but small scenes needs :attr:`values` of a selection.

    Attributes:
        source: (M, F) float32; rows that are not valid are zero.
        valid: (N,) bool; False where the neighbourhood could not be described.
        rows: (N,) row of ``source`` for each point; None: they are the same.
    """

    source: Float[np.ndarray, 'rows features']
    valid: Bool[np.ndarray, ' points']
    rows: Int[np.ndarray, ' points'] | None = None

    def __post_init__(self) -> None:
        if self.source.ndim != 2 or self.source.dtype != np.float32:
            raise ValueError(
                f'Descriptors.values: expected float32 (N, F), got {self.source.dtype} {self.source.shape}'
            )
        points = len(self.source) if self.rows is None else len(self.rows)
        if self.valid.shape != (points,) or self.valid.dtype != np.bool_:
            raise ValueError(f'Descriptors.valid: expected bool ({points},), got {self.valid.shape}')

    def __len__(self) -> int:
        return len(self.valid)

    @property
    def values(self) -> Float[np.ndarray, 'points features']:
        """(N, F) the vector of each point; a copy where this is a selection."""
        return self.source if self.rows is None else self.source[self.rows]

    def row_numbers(self) -> Int[np.ndarray, ' points']:
        """Row of ``source`` for each point."""
        return np.arange(len(self.source)) if self.rows is None else self.rows

    def select(self, index: Int[np.ndarray, ' kept']) -> 'Descriptors':
        """Those of some points, in that order; no vector is copied."""
        return Descriptors(self.source, self.valid[index], self.row_numbers()[index])
