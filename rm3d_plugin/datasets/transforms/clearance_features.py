"""What stands above and below a point, as further columns of the points."""

from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.transforms.recent import RecentArrays
from rm3d_plugin.ops.clearance import clearance
from rm3d_plugin.registry import TRANSFORMS

REACHES = (0, 1)  # cells to each side: a narrow and a wide column


def clearance_columns(xyz: Float[np.ndarray, 'points 3'], cell: float = 0.5) -> Float[np.ndarray, 'points columns']:
    """Six columns in [0, 1] for a narrow and for a wide look, see :func:`rm3d_plugin.ops.clearance.clearance`.

    Args:
        xyz: (n, 3) metres, z the height above the ground.
        cell: Metres; width of the narrow look, a third of that of the wide one.
    """
    return np.concatenate([clearance(xyz, cell, reach) for reach in REACHES], axis=1)


@TRANSFORMS.register_module()
class ClearanceFeatures:
    """Appends ``clearance`` columns (:class:`~rm3d_plugin.models.segmentors.PointInputs`) behind those the points have.

    A wire has nothing below it for metres, a trunk has a crown above, a facade fills its column: this holds for scans
    of any density, and a network that sees few scenes need not find it out itself. Belongs behind
    ``HeightAboveGround`` and before any crop or turn.

    Args:
        cell: Metres; larger: coarser heights, fewer gaps by chance.
    """

    column: ClassVar[str] = 'clearance'

    def __init__(self, cell: float = 0.5) -> None:
        if not 0 < cell < np.inf:
            raise ValueError(f'ClearanceFeatures.cell: expected metres > 0, got {cell}')
        self.cell = float(cell)
        self._recent = RecentArrays()

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Compute, then append.

        Raises:
            ValueError: An augmented view was already taken.
        """
        if 'views' in results:
            raise ValueError('ClearanceFeatures: expected AugmentedView behind it')
        points = results['points']
        xyz = np.ascontiguousarray(points[:, :3])
        values = self._recent.get_or_make(xyz, lambda: clearance_columns(xyz, self.cell))
        return results | {'points': np.concatenate([points, values.astype(points.dtype)], axis=1)}
