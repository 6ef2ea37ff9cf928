"""Two partial views of one scan, as pre-training needs them where there are no frames."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.transforms.augmented_view import View, ViewSettings, augmented_view, random_crop
from rm3d_plugin.datasets.transforms.points import select_points
from rm3d_plugin.registry import TRANSFORMS

TRIES = 10  # draws of a second part that overlaps the first enough


class Overlap(NamedTuple):
    """Rows of two parts of a scene, ascending."""

    first: Int[np.ndarray, ' first']
    second: Int[np.ndarray, ' second']


def overlapping_rows(
    points: Float[np.ndarray, 'points channels'],
    share: tuple[float, float],
    overlap: float,
    rng: np.random.Generator,
) -> Overlap:
    """Two random parts of a scene that have points in common.

    Args:
        points: (n, 3 + channels) metres.
        share: Least and greatest share of the points in each part.
        overlap: Least share of the second part that lies in the first, too. Where no draw of ten has it, the second
            part is the first.
        rng: The only source of chance.
    """
    first = random_crop(points, share, rng)
    inside = np.zeros(len(points), dtype=bool)
    inside[first] = True
    for _ in range(TRIES):
        second = random_crop(points, share, rng)
        if inside[second].sum() >= overlap * len(second):
            return Overlap(first, second)
    return Overlap(first, first)


@TRANSFORMS.register_module()
class OverlappingCrops:
    """Leaves one part of the scene, and makes of another, which overlaps it, a further view with its own augmentation.

    It stands where :class:`AugmentedView` may stand. Points of the view that the first part lacks have point id -1.

    Args:
        share: Least and greatest share of the points in each part.
        overlap: Least share of the second part that lies in the first.
        view: Fields of :class:`ViewSettings`, of the second part.
    """

    def __init__(
        self, share: tuple[float, float] = (0.5, 0.8), overlap: float = 0.3, view: dict[str, Any] | None = None
    ) -> None:
        if not 0 < share[0] <= share[1] <= 1 or not 0 <= overlap <= 1:
            raise ValueError(f'OverlappingCrops: expected shares in (0, 1], least first, got {share} and {overlap}')
        self.share, self.overlap, self.settings = (share[0], share[1]), overlap, ViewSettings(**(view or {}))

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw both parts by the item's generator."""
        points, rng = results['points'], results['rng']
        first, second = overlapping_rows(points, self.share, self.overlap, rng)
        view = augmented_view(points[second], self.settings, rng)
        place = np.full(len(points), -1, dtype=np.int64)
        place[first] = np.arange(len(first))
        seen = View(view.points, place[second[view.point_ids]])
        return select_points(results, first) | {'views': [seen]}
