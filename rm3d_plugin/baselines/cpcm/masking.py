"""A view whose colours are hidden in most cells of a grid (contextual masking of CPCM, ICCV 2023)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rm3d_plugin.datasets.transforms.augmented_view import View
from rm3d_plugin.registry import TRANSFORMS

_GREY = 0.5  # nothing, to the network


@dataclass(frozen=True)
class MaskSettings:
    """What is hidden.

    Attributes:
        cells: Cells of the grid along each axis. Larger: smaller holes, easier.
        share: Of the cells, those whose colours are hidden.

    Raises:
        ValueError: No cell, or no share.
    """

    cells: int = 4  # of the released code for 0.1 % of the points; 8 for 0.01 %
    share: float = 0.75

    def __post_init__(self) -> None:
        if self.cells < 1 or not 0 <= self.share <= 1:
            raise ValueError(f'MaskedView: expected cells >= 1 and a share in [0, 1], got {self}')


def hidden_points(
    xyz: Float[np.ndarray, 'points 3'], settings: MaskSettings, rng: np.random.Generator
) -> Bool[np.ndarray, ' points']:
    """Points in the hidden cells of a grid whose borders are quantiles of each axis's different coordinates.

    Args:
        xyz: Metres.
        settings: Of the grid.
        rng: Draws the hidden cells.
    """
    inner = np.linspace(0.0, 1.0, settings.cells + 1)[1:-1]
    hidden = rng.permutation(settings.cells**3) < round(settings.share * settings.cells**3)
    if len(xyz) == 0:
        return np.zeros(0, dtype=bool)
    place = [np.searchsorted(np.quantile(np.unique(axis), inner), axis, side='right') for axis in xyz.T]
    return hidden[np.ravel_multi_index(place, (settings.cells,) * 3)]


@TRANSFORMS.register_module()
class MaskedView:
    """Appends to ``views`` the points as they are, all columns but x, y, z hidden in some cells.

    Where scans have no colour, what they have instead is hidden: intensity, shapes. Comes last before PackScene. The
    arguments are those of :class:`MaskSettings`.
    """

    def __init__(self, **settings: Any) -> None:
        self.settings = MaskSettings(**settings)

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Hide by the item's generator."""
        points = results['points'].copy()
        points[hidden_points(points[:, :3], self.settings, results['rng']), 3:] = _GREY
        view = View(points, np.arange(len(points)))
        return results | {'views': [*results.get('views', ()), view]}
