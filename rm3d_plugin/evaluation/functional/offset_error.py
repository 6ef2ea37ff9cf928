"""How far centres of instances are off: the offset error of the paper's Figure 8 (METHOD 9)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Integer

from rm3d_plugin.ops.segment import number_pairs


@dataclass(frozen=True, eq=False)
class OffsetError:
    """Sums over points of true instances; the sums of several scenes add up.

    Attributes:
        metres: (C,) sum of the distances between the pseudo (or voted) and the true centre, by true class.
        points: (C,) points that have both.
    """

    metres: Float[np.ndarray, ' classes']
    points: Int[np.ndarray, ' classes']

    def __add__(self, other: 'OffsetError') -> 'OffsetError':
        return OffsetError(self.metres + other.metres, self.points + other.points)

    @classmethod
    def none(cls, num_classes: int) -> 'OffsetError':
        """Of no point."""
        return cls(np.zeros(num_classes), np.zeros(num_classes, dtype=np.int64))


def instance_centres(
    xyz: Float[np.ndarray, 'points 3'],
    semantic: Integer[np.ndarray, ' points'],
    instance: Integer[np.ndarray, ' points'],
) -> Float[np.ndarray, 'points 3']:
    """Centroid of the instance of each point, metres; NaN for points of none.

    Args:
        xyz: Points, metres.
        semantic: Class of each point, < 0 = none.
        instance: Instance of each point, < 0 = none; one number under two classes is two instances.
    """
    out = np.full((len(xyz), 3), np.nan)
    own = (instance >= 0) & (semantic >= 0)
    number, first = number_pairs(semantic[own], instance[own])
    size = np.bincount(number, minlength=len(first))
    sums = [np.bincount(number, weights=axis, minlength=len(first)) for axis in xyz[own].T.astype(np.float64)]
    out[own] = (np.stack(sums, axis=1) / size[:, None])[number]
    return out


def offset_error(
    centres: Float[np.ndarray, 'points 3'],
    true_centres: Float[np.ndarray, 'points 3'],
    truth: Int[np.ndarray, ' points'],
    num_classes: int,
) -> OffsetError:
    """Distances between two centres of each point by true class; a point without one of them does not count.

    The offset of a point is the way to its centre, so this is the length of the difference of two offsets. The paper's
    Figure 8 shows "the pseudo label quality and its influence on the predict errors in offset" and defines neither.
    Read here: the offsets are those of the pseudo labels, so the points are the ones whose pseudo labels are scored
    (not the annotated ones), and a point whose pseudo label has the wrong class counts with the centre that it was
    given. To leave those out would hide the very influence that the figure is about: the more wrong labels, the fewer
    errors. The same function on the centres that the network predicts is ``vote_error``, the figure's other reading.

    Args:
        centres: Pseudo or voted centre, metres, NaN = none.
        true_centres: True centre, metres, NaN = none.
        truth: True class.
        num_classes: Number of classes.
    """
    distance = np.linalg.norm(centres - true_centres, axis=1)
    used = np.isfinite(distance) & (truth >= 0) & (truth < num_classes)
    return OffsetError(
        np.bincount(truth[used], weights=distance[used], minlength=num_classes).astype(np.float64),
        np.bincount(truth[used], minlength=num_classes),
    )
