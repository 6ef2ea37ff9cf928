"""What a descriptor provider hands back."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True, eq=False)
class Descriptors:
    """One feature vector a point.

    Attributes:
        values: (N, F) float32; rows that are not valid are zero.
        valid: (N,) bool; False where the neighbourhood could not be described.
    """

    values: Float[np.ndarray, 'points features']
    valid: Bool[np.ndarray, ' points']

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.dtype != np.float32:
            raise ValueError(
                f'Descriptors.values: expected float32 (N, F), got {self.values.dtype} {self.values.shape}'
            )
        if self.valid.shape != (len(self.values),) or self.valid.dtype != np.bool_:
            raise ValueError(f'Descriptors.valid: expected bool ({len(self.values)},), got {self.valid.shape}')

    def __len__(self) -> int:
        return len(self.values)
