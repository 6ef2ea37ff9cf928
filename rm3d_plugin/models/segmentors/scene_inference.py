"""How a trained segmentor reads a scene: whole or in chunks, once or from several sides."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.segmentors.chunks import Chunk, Progress, average_rows, make_chunks
from rm3d_plugin.ops.segment import segment_mean

Flip = Literal['none', 'both']
Predict = Callable[[Tensor], Float[Tensor, 'rows columns']]
Refine = Callable[[Tensor, Tensor], Tensor]
"""Points (n, D) and class probabilities (n, C) of a scene, on the CPU -> class probabilities."""


@dataclass(frozen=True)
class SceneInference:
    """What a scene costs at test time.

    Attributes:
        max_points: Scenes with more points are predicted in chunks of at most so many; None: whole, whatever it takes.
        chunk_size: Metres; edge of the chunks seen from above. None: as large as ``max_points`` allows.
        margin: Metres that chunks reach into each other; larger: fewer seams, more work.
        tta_rotations: Directions about z from which the scene is read, evenly spaced; probabilities and offsets are
            averaged.
        flip: 'both': from each direction mirrored, too, which doubles the work.
        first_angle: Degrees by which the first direction is turned. Walls along the axes fill whole layers of voxels,
            which a network that is trained on turned rooms hardly ever saw; it reads a turned room better.
        stitch_iou: Instances of one class in two chunks are one where they overlap at least so much, among the points
            that both chunks have.
        superpoint_smoothing: In [0, 1]: how much of a point's probabilities is the mean over its region (transform
            ``RegionNumbers``); the rest is its own. Larger: things have one class, regions that mix two things as well.
        logit_adjustment: Probabilities are multiplied by (annotated labels of the class) ^ this, since crops and class
            weights show rare classes more often than they are. Larger: they are said more rarely; 0: as trained.
    """

    max_points: int | None = None
    chunk_size: float | None = None
    margin: float = 1.0
    tta_rotations: int = 1
    flip: Flip = 'none'
    first_angle: float = 0.0
    stitch_iou: float = 0.5
    superpoint_smoothing: float = 0.0
    logit_adjustment: float = 0.0

    def __post_init__(self) -> None:
        if self.flip not in get_args(Flip):
            raise ValueError(f'inference.flip: expected one of {get_args(Flip)}, got {self.flip!r}')
        for name in ('max_points', 'tta_rotations'):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int) and value >= 1):
                raise ValueError(f'inference.{name}: expected a whole number from 1, got {value!r}')
        if self.tta_rotations is None:
            raise ValueError('inference.tta_rotations: expected a whole number from 1, got None')
        if not -np.inf < self.first_angle < np.inf:
            raise ValueError(f'inference.first_angle: expected degrees, got {self.first_angle!r}')
        if self.chunk_size is not None and not 0 < self.chunk_size < np.inf:
            raise ValueError(f'inference.chunk_size: expected metres > 0, got {self.chunk_size}')
        if not 0 <= self.margin < np.inf or not 0 < self.stitch_iou <= 1:
            raise ValueError(f'inference: expected margin >= 0 and 0 < stitch_iou <= 1, got {self}')
        if not 0 <= self.superpoint_smoothing <= 1:
            raise ValueError(
                f'inference.superpoint_smoothing: expected a share from 0 to 1, got {self.superpoint_smoothing}'
            )
        if not 0 <= self.logit_adjustment < np.inf:
            raise ValueError(f'inference.logit_adjustment: expected a number from 0, got {self.logit_adjustment}')

    @property
    def views(self) -> Float[np.ndarray, 'views 3 3']:
        """See :func:`view_matrices`."""
        return view_matrices(self.tta_rotations, self.flip, self.first_angle)

    @property
    def one_view(self) -> Float[np.ndarray, '1 3 3']:
        """The first view alone."""
        return self.views[:1]

    def chunks(self, xyz: Float[np.ndarray, 'points 3']) -> list[Chunk]:
        """See :func:`make_chunks`."""
        return make_chunks(xyz, self.max_points, self.chunk_size, self.margin)

    def is_plain(self, num_points: int) -> bool:
        """Whether a scene of so many points is read once and whole, for certain."""
        whole = self.chunk_size is None if self.max_points is None else num_points <= self.max_points
        return num_points == 0 or (whole and np.array_equal(self.views, np.eye(3)[None]))


def view_matrices(rotations: int, flip: Flip = 'none', first_angle: float = 0.0) -> Float[np.ndarray, 'views 3 3']:
    """Rotations by 360 / ``rotations`` degrees about z, the first by ``first_angle``; 'both': each mirrored, too.

    >>> view_matrices(4)[1].tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    angle = 2 * np.pi * np.arange(rotations) / rotations + np.radians(first_angle)
    cos, sin = (np.where(np.abs(v - np.round(v)) < 1e-12, np.round(v), v) for v in (np.cos(angle), np.sin(angle)))
    turned = np.zeros((rotations, 3, 3))
    turned[:, 0, 0] = turned[:, 1, 1] = cos
    turned[:, 0, 1], turned[:, 1, 0], turned[:, 2, 2] = -sin, sin, 1.0
    turned += 0.0  # no negative zeros
    return turned if flip == 'none' else np.concatenate([turned, turned @ np.diag([1.0, -1.0, 1.0])])


def turn(points: Float[Tensor, 'points columns'], matrix: Float[np.ndarray, '3 3']) -> Float[Tensor, 'points columns']:
    """Points seen from another side: x, y, z turned, the other columns as they are."""
    if np.array_equal(matrix, np.eye(3)):
        return points
    xyz = points[:, :3].double() @ torch.from_numpy(matrix).T.to(points.device)
    return torch.cat([xyz.to(points.dtype), points[:, 3:]], dim=1)


def mix_regions(
    probs: Float[Tensor, 'points classes'], regions: Int[Tensor, ' points'], share: float
) -> Float[Tensor, 'points classes']:
    """Probabilities of points, drawn towards the mean of their region.

    Args:
        probs: Of each point.
        regions: Region of each point; points of region -1 keep theirs.
        share: Of the mean; 0: points as they are, 1: the same for all points of a region.

    >>> mix_regions(torch.tensor([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]), torch.tensor([0, 0, -1]), 0.5).tolist()
    [[0.75, 0.25], [0.25, 0.75], [0.0, 1.0]]
    """
    labels = regions.numpy()
    means = torch.from_numpy(segment_mean(probs.numpy(), labels, int(labels.max(initial=-1)) + 1)).to(probs)
    known = regions >= 0
    mixed = probs.clone()
    mixed[known] = torch.lerp(probs[known], means[regions[known]], share)
    return mixed


def by_class_frequency(
    probs: Float[Tensor, 'points classes'], counts: Float[Tensor, ' classes'], power: float
) -> Float[Tensor, 'points classes']:
    """Probabilities times counts^power, adding up to 1 again; a class without a count has that of a count of 1.

    >>> by_class_frequency(torch.tensor([[0.5, 0.5]]), torch.tensor([9.0, 1.0]), 0.5).tolist()
    [[0.75, 0.25]]
    """
    weighed = probs * counts.clamp_min(1.0).pow(power)
    return weighed / weighed.sum(dim=1, keepdim=True)


def average_views(
    points: Float[Tensor, 'points columns'],
    views: Float[np.ndarray, 'views 3 3'],
    chunks: Sequence[Chunk],
    look: Callable[[Tensor], Predict],
    scalars: int,
    progress: Progress = iter,
) -> Float[Tensor, 'points values']:
    """What is said of each point, the mean over chunks and views; on the CPU.

    Args:
        points: The scene; x, y, z first.
        views: Orthogonal matrices.
        chunks: Of the scene.
        look: A turned scene -> a function from rows to what is said of them.
        scalars: Columns of the answer that are the same from every side; those behind are vectors, which are turned
            back.
        progress: Shows how far a view is.
    """
    total: Tensor | None = None
    for matrix in views:
        values = average_rows(chunks, len(points), look(turn(points, matrix)), progress).float()
        if values.shape[1] > scalars and not np.array_equal(matrix, np.eye(3)):
            back = values[:, scalars:].double() @ torch.from_numpy(matrix)  # the inverse, on rows
            values = torch.cat([values[:, :scalars], back.float()], dim=1)
        total = values if total is None else total + values
    assert total is not None
    return total if len(views) == 1 else total / len(views)
