"""Viewpoint Bottleneck: channels of two views agree and are independent of each other (Luo et al., 2021)."""

from typing import Any, Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.losses import LossTerm
from rm3d_plugin.models.pretraining import Encoded, match_views
from rm3d_plugin.ops.sampling import furthest_point_sample
from rm3d_plugin.registry import MODELS

Version = Literal['paper', 'code']
DRAWN = 8  # times as many common points are drawn before the furthest of them are chosen


def standardised(features: Float[Tensor, 'points channels']) -> Float[Tensor, 'points channels']:
    """Each channel with mean 0 and deviation 1 over the points."""
    centered = features - features.mean(dim=0)
    return centered / centered.square().mean(dim=0).add(1e-6).sqrt()


def bottleneck_loss(
    first: Float[Tensor, 'points channels'],
    second: Float[Tensor, 'points channels'],
    off_diagonal: float = 3.9e-3,
    version: Version = 'paper',
) -> Float[Tensor, '']:
    """Distance of the channels' cross-correlation from the identity.

    Args:
        first: Features of points in one view.
        second: Of the same points in the other.
        off_diagonal: Weight of the correlations between different channels.
        version: 'paper': sum of ``(1 - C_dd)^2`` and of ``C_de^2``. 'code': the released code, which takes 1 from the
            diagonal twice, so that it aims at 2, and divides both by 512 whatever the number of channels.
    """
    correlation = standardised(first.float()).T @ standardised(second.float()) / len(first)
    diagonal = correlation.diagonal()
    apart = correlation.square().sum() - diagonal.square().sum()
    aim, factor = (1.0, 1.0) if version == 'paper' else (2.0, 1 / 512)
    return factor * ((aim - diagonal).square().sum() + off_diagonal * apart)


@MODELS.register_module()
class ViewpointBottleneck(LossTerm):
    """``loss_bottleneck``: :func:`bottleneck_loss` of each scene's common points that lie furthest apart.

    Args:
        in_channels: Features of the backbone.
        channels: Of the projection that is compared; it is dropped afterwards. 256, 512 and 1024 do alike.
        points: Common points of each scene.
        off_diagonal: See :func:`bottleneck_loss`, as the next.
        version: 'paper' or 'code'.
    """

    needs = ('features',)

    def __init__(
        self,
        in_channels: int,
        channels: int = 512,
        points: int = 1024,
        off_diagonal: float = 3.9e-3,
        version: Version = 'paper',
    ) -> None:
        super().__init__()
        if version not in get_args(Version):
            raise ValueError(f'ViewpointBottleneck.version: expected paper or code, got {version!r}')
        self.project = nn.Linear(in_channels, channels)
        self.points, self.off_diagonal, self.version = points, off_diagonal, version

    def forward(self, batch: Batch, outputs: Encoded, labels: Any) -> dict[str, Tensor]:
        """The mean over scenes and views; 0 where views have less than two points in common."""
        terms = [0.0 * self.project(outputs.features).sum()]
        drawn = DRAWN * self.points * len(batch.sizes)
        for view in batch.views:
            found = match_views(outputs.features, batch.xyz, batch.batch_offsets, view, drawn)
            for number in found.scene.unique().tolist():
                scene = found.of_scene(number)
                rows = furthest_point_sample(scene.xyz, self.points)
                if len(rows) > 1:
                    pair = self.project(scene.first[rows]), self.project(scene.second[rows])
                    terms.append(bottleneck_loss(*pair, self.off_diagonal, self.version))
        return {'loss_bottleneck': torch.stack(terms).sum() / max(len(terms) - 1, 1)}
