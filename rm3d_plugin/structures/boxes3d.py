"""Oriented boxes with their classes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int


def box_rows(boxes: Any) -> Any:
    """Rows (x, y, z, dx, dy, dz, yaw) about the middle of each box.

    mmdetection3d keeps the middle of the bottom face; ``gravity_center`` of its boxes is the middle.

    Args:
        boxes: ``LiDARInstance3DBoxes`` or ``DepthInstance3DBoxes``, whose columns after the seventh (velocities) are
            left out; anything else is handed back as it is.

    Raises:
        ValueError: They lie in a camera's frame, whose y points down.
    """
    if not hasattr(boxes, 'gravity_center'):
        return boxes
    if getattr(boxes, 'YAW_AXIS', 2) != 2:
        raise ValueError(
            f'{type(boxes).__name__}: expected boxes that turn about z; call convert_to(Box3DMode.LIDAR) or '
            'convert_to(Box3DMode.DEPTH) first'
        )
    rows = boxes.tensor[:, :7].clone()
    rows[:, :3] = boxes.gravity_center
    return rows


@dataclass(frozen=True, eq=False)
class Boxes3D:
    """Boxes that stand upright and turn about z.

    Attributes:
        tensor: (M, 7) float64 rows (x, y, z, dx, dy, dz, yaw): centre of gravity in metres (scene frame, z up), length
            along the heading, width, height in metres, yaw in radians counter-clockwise from +x. Boxes of mmdetection3d
            may be given as they are, see :func:`box_rows`.
        labels: (M,) int64 class numbers.
        scores: (M,) float64 in [0, 1]; 1 where none is given.

    Raises:
        ValueError: A shape does not fit, a number is not finite, or a size is not positive.
    """

    tensor: Float[np.ndarray, 'boxes 7'] | Any  # an array once made
    labels: Int[np.ndarray, ' boxes']
    scores: Float[np.ndarray, ' boxes'] | None = None

    def __post_init__(self) -> None:
        rows = box_rows(self.tensor)
        tensor = np.asarray(rows.cpu() if hasattr(rows, 'cpu') else rows, dtype=np.float64).reshape(-1, 7)
        labels = np.asarray(self.labels, dtype=np.int64).reshape(-1)
        scores = np.ones(len(tensor)) if self.scores is None else np.asarray(self.scores, dtype=np.float64).reshape(-1)
        if not len(tensor) == len(labels) == len(scores):
            raise ValueError(f'Boxes3D: {len(tensor)} boxes, {len(labels)} labels, {len(scores)} scores')
        if not np.isfinite(tensor).all():
            raise ValueError('Boxes3D.tensor: a number is NaN or infinite')
        if len(tensor) and tensor[:, 3:6].min() <= 0:
            raise ValueError(f'Boxes3D.tensor: sizes must be positive, got {tensor[:, 3:6].min()}')
        for name, value in (('tensor', tensor), ('labels', labels), ('scores', scores)):
            object.__setattr__(self, name, value)

    @classmethod
    def empty(cls) -> 'Boxes3D':
        """No box."""
        return cls(np.zeros((0, 7)), np.zeros(0, dtype=np.int64))

    def __len__(self) -> int:
        return len(self.tensor)

    def select(self, index: np.ndarray) -> 'Boxes3D':
        """The boxes that ``index`` (integers or a boolean mask) names."""
        assert self.scores is not None
        return Boxes3D(self.tensor[index], self.labels[index], self.scores[index])

    def corners(self) -> Float[np.ndarray, 'boxes 8 3']:
        """Corners in metres: bottom four counter-clockwise, then the top four above them."""
        unit = np.array([[0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]])
        local = np.concatenate([np.c_[unit, np.full(4, -0.5)], np.c_[unit, np.full(4, 0.5)]])
        local = local[None] * self.tensor[:, None, 3:6]
        c, s = np.cos(self.tensor[:, 6]), np.sin(self.tensor[:, 6])
        x = local[..., 0] * c[:, None] - local[..., 1] * s[:, None]
        y = local[..., 0] * s[:, None] + local[..., 1] * c[:, None]
        return np.stack([x, y, local[..., 2]], axis=-1) + self.tensor[:, None, :3]
