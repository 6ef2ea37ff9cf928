"""Orientation encoding at several scales (Jiang et al., PointSIFT, arXiv 1807.00652; METHOD 3, Point-SIFT)."""

from collections.abc import Sequence
from typing import final

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from rm3d_plugin.ops.octant_neighbors import octant_neighbors
from rm3d_plugin.registry import MODELS


class OrientationEncoding(nn.Module):
    """One unit: the eight neighbours of a point become one vector, axis by axis, and the point's own is added.

    The neighbours are the corners of a 2 x 2 x 2 grid; three convolutions of two cells, along x, y and z, each halve
    it.

    Args:
        channels: In and out.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.axes = nn.ModuleList(nn.Linear(2 * channels, channels) for _ in range(3))
        self.norm = nn.LayerNorm(channels)

    def forward(
        self, values: Float[Tensor, 'points channels'], neighbors: Int[Tensor, 'points 8']
    ) -> Float[Tensor, 'points channels']:
        """Encode every point.

        Args:
            values: One row a point.
            neighbors: See :func:`rm3d_plugin.ops.octant_neighbors.octant_neighbors`.
        """
        grid = values[neighbors.reshape(-1)].view(len(values), 8, -1)
        for axis in self.axes:
            half = grid.shape[1] // 2
            grid = torch.relu(axis(torch.cat([grid[:, :half], grid[:, half:]], dim=2)))
        return self.norm(values + grid[:, 0])


@MODELS.register_module()
@final
class PointSIFTBackbone(nn.Module):
    """Orientation-encoding units of growing radius, one behind the other; what each says is joined (scale awareness).

    ::

        inputs -> linear -> unit, r[0] -> unit, r[1] -> ... -> unit, r[-1]
                               |             |                    |
                               +-------------+--------------------+-> joined -> linear

    Smaller than the original: every point keeps its place at all scales, where the original samples 1024, 256 and 64
    points and interpolates back; so what is said of a point depends on nothing farther than the radii together.

    Args:
        in_channels: Features of a point.
        channels: Of every unit, and of what is said of a point.
        radii: Of the units, in the unit of the coordinates.
    """

    def __init__(self, in_channels: int, channels: int = 32, radii: Sequence[float] = (2.0, 4.0, 8.0)) -> None:
        super().__init__()
        if not radii or min(radii) <= 0:
            raise ValueError(f'PointSIFTBackbone.radii: expected lengths above 0, at least one, got {list(radii)}')
        self.radii, self.out_channels = tuple(radii), channels
        self.first = nn.Linear(in_channels, channels)
        self.units = nn.ModuleList(OrientationEncoding(channels) for _ in radii)
        self.joined = nn.Linear(channels * len(radii), channels)

    @property
    def reach(self) -> float:
        """How far, along an axis, lie points that change what is said of one."""
        return float(sum(self.radii))

    def forward(
        self,
        xyz: Float[Tensor, 'points 3'],
        features: Float[Tensor, 'points in_channels'],
        batch_offsets: Int[Tensor, ' scenes_and_one'],
    ) -> Float[Tensor, 'points out']:
        """What is said of the points of a batch."""
        values, scales = torch.relu(self.first(features)), []
        for radius, unit in zip(self.radii, self.units, strict=True):
            values = unit(values, _neighbors(xyz, batch_offsets, radius))
            scales.append(values)
        return torch.relu(self.joined(torch.cat(scales, dim=1)))


def _neighbors(xyz: Tensor, batch_offsets: Tensor, radius: float) -> Int[Tensor, 'points 8']:
    """Octant neighbours within each scene, as rows of the batch."""
    bounds, places = batch_offsets.tolist(), xyz.detach().cpu().numpy()
    scenes = zip(bounds, bounds[1:], strict=False)
    found = [torch.from_numpy(octant_neighbors(places[start:stop], radius)) + start for start, stop in scenes]
    return torch.cat(found).to(xyz.device)
