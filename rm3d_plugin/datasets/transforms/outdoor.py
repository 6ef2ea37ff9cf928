"""Transforms of streets: heights from the ground, crops that meet rare classes."""

from typing import Any, get_args

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.transforms.points import Shape, crop_rows, select_points
from rm3d_plugin.datasets.transforms.recent import RecentArrays
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.registry import TRANSFORMS
from rm3d_plugin.storage import content_key
from rm3d_plugin.structures import UNLABELLED


def with_heights(
    points: Float[np.ndarray, 'points channels'], heights: Float[np.ndarray, ' points']
) -> Float[np.ndarray, 'points channels']:
    """The scene with its ground pulled flat: z becomes the height above the ground below (negative under it).

    Upright things stay upright, so poles and facades keep their shape; what changes is the slope of the street.

    Args:
        points: (n, 3 + channels), metres, z up; channels stay.
        heights: Metres.
    """
    out = points.copy()
    out[:, 2] = heights
    return out


@TRANSFORMS.register_module()
class HeightAboveGround:
    """Measure heights from the ground; belongs before any crop, since a whole scene shows its ground best.

    What the network is asked for (classes of points) does not depend on where they lie. Shifted points
    (``pred_point_centers``) are then told in the levelled scene.

    Args:
        recent: Scenes whose heights stay in memory. Larger: more memory; data sets of as many scenes are levelled once.
        options: Of :func:`~rm3d_plugin.ops.ground.segment_ground`.
    """

    def __init__(self, recent: int = 16, **options: Any) -> None:
        self.options = options
        self._recent = RecentArrays.shared(content_key('heights', options), recent)

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Find the ground, then level it.

        Raises:
            ValueError: The scene has boxes, which would no longer fit, or an augmented view was already taken.
        """
        if len(results.get('boxes', ())) or 'views' in results:
            raise ValueError('HeightAboveGround: expected a scene without boxes, and AugmentedView behind it')
        xyz = np.ascontiguousarray(results['points'][:, :3])
        heights = self._recent.get_or_make(xyz, lambda: segment_ground(xyz, **self.options).height)
        return results | {'points': with_heights(results['points'], heights)}


def class_center(semantic: Int[np.ndarray, ' points'], rng: np.random.Generator, classes: float = 1.0) -> int:
    """Number of a random point of a class that is itself drawn, each labelled class being as likely; else of any point.

    Args:
        semantic: (n,) classes, -1 = unlabelled; n >= 1.
        rng: Source of the draw.
        classes: Share of the draws that go by class; the others take any point, labelled or not.
    """
    known = np.unique(semantic[semantic >= 0])
    if len(known) == 0 or rng.random() >= classes:
        return int(rng.integers(len(semantic)))
    rows = np.flatnonzero(semantic == known[rng.integers(len(known))])
    return int(rows[rng.integers(len(rows))])


@TRANSFORMS.register_module()
class ClassCrop:
    """Keep the part of a scene around a point of a class drawn by chance, so that rare classes are met as often.

    Args:
        max_points: Most points to keep.
        shape: See :func:`~rm3d_plugin.datasets.transforms.crop_rows`.
        classes: Share of the crops that lie around a labelled point; the others lie anywhere.
    """

    def __init__(self, max_points: int, shape: Shape = 'column', classes: float = 0.8) -> None:
        if max_points < 1 or not 0 <= classes <= 1:
            raise ValueError(f'ClassCrop: expected max_points >= 1 and a share, got {max_points} and {classes}')
        if shape not in get_args(Shape):
            raise ValueError(f'ClassCrop.shape: expected one of {get_args(Shape)}, got {shape!r}')
        self.max_points, self.shape, self.classes = max_points, shape, classes

    def __call__(self, results: dict[str, Any]) -> dict[str, Any]:
        """Draw a centre, then crop."""
        points = results['points']
        if len(points) <= self.max_points:
            return results
        semantic = results['semantic'] if 'semantic' in results else np.full(len(points), UNLABELLED)
        row = class_center(semantic, results['rng'], self.classes)
        rows = crop_rows(points[:, :3], points[row, :3].astype(np.float64), self.max_points, self.shape)
        return select_points(results, rows)
