"""A small PointNet on each point's neighbourhood (Landrieu and Boussaha, CVPR 2019; METHOD 3, S-SPG)."""

from typing import final

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from rm3d_plugin.ops.nearest_within import nearest_in_batch
from rm3d_plugin.registry import MODELS


@MODELS.register_module()
@final
class LocalCloudEmbedder(nn.Module):
    """What is said of a point depends on its nearest neighbours alone.

    ::

        neighbours - point -> turn about z (a small PointNet says how) -> PointNet -> max -+-> layers
        features of the point -------------------------------------------------------------+

    The turn is a 2 x 2 matrix on x and y that begins as the identity.

    Args:
        in_channels: Features of a point.
        channels: Of what is said.
        neighbors: k, the point itself among them.
        radius: Neighbours lie within it, in the unit of the coordinates; so a point's reach is bounded.
        width: Of the layers.
    """

    def __init__(
        self, in_channels: int, channels: int = 32, neighbors: int = 20, radius: float = 5.0, width: int = 32
    ) -> None:
        super().__init__()
        if neighbors < 1 or not radius > 0:
            raise ValueError(
                f'LocalCloudEmbedder: expected neighbors >= 1 and radius > 0, got {neighbors} and {radius}'
            )
        self.neighbors, self.radius, self.out_channels = neighbors, radius, channels
        self.turn_points = _layers(3, width // 2, width)
        self.turn = nn.Linear(width, 4)
        nn.init.zeros_(self.turn.weight)
        nn.init.zeros_(self.turn.bias)
        self.points = _layers(3, width, 2 * width)
        self.head = _layers(2 * width + in_channels, 2 * width, channels)

    @property
    def reach(self) -> float:
        """How far, along an axis, lie points that change what is said of one."""
        return self.radius

    def forward(
        self,
        xyz: Float[Tensor, 'points 3'],
        features: Float[Tensor, 'points in_channels'],
        batch_offsets: Int[Tensor, ' scenes_and_one'],
    ) -> Float[Tensor, 'points out']:
        """What is said of the points of a batch."""
        near = nearest_in_batch(xyz, batch_offsets, self.radius, self.neighbors)
        local = (xyz[near] - xyz[:, None]) / self.radius
        pooled = self.points(self._turned(local)).amax(dim=1)
        return torch.relu(self.head(torch.cat([pooled, features], dim=1)))

    def _turned(self, local: Float[Tensor, 'points near 3']) -> Float[Tensor, 'points near 3']:
        turn = self.turn(self.turn_points(local).amax(dim=1)).view(-1, 2, 2) + torch.eye(2).to(local)
        return torch.cat([local[..., :2] @ turn, local[..., 2:]], dim=2)


def _layers(first: int, hidden: int, last: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(first, hidden), nn.LayerNorm(hidden), nn.ReLU(), nn.Linear(hidden, last))
