"""PointContrast: a point is alike in two views, and unlike all others (Xie et al., ECCV 2020)."""

from typing import Any, Literal, get_args

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.losses import LossTerm, contrastive_loss, hardest_contrastive_loss
from rm3d_plugin.models.pretraining import Encoded, Matches, match_views
from rm3d_plugin.registry import MODELS

Kind = Literal['info_nce', 'hardest']
NEAR = 1.5  # voxels up to which points match, in the paper and the code


@MODELS.register_module()
class PointContrast(LossTerm):
    """``loss_contrast`` of the points that two views have in common; negatives are other common points of the batch.

    Points nearer than 1.5 voxels match, so they are no negatives of each other: those of one voxel have one feature.

    Args:
        in_channels: Features of the backbone.
        voxel_size: Metres.
        kind: 'info_nce', or 'hardest': the nearest negative alone, in both directions.
        channels: Of the projection that is compared; it is dropped afterwards.
        pairs: Most common points of a batch.
        temperature: Of 'info_nce'; the released script has 0.4, its code 0.07.
    """

    needs = ('features',)

    def __init__(
        self,
        in_channels: int,
        voxel_size: float,
        kind: Kind = 'info_nce',
        channels: int = 32,
        pairs: int = 4096,
        temperature: float = 0.4,
    ) -> None:
        super().__init__()
        if kind not in get_args(Kind):
            raise ValueError(f'PointContrast.kind: expected one of {", ".join(get_args(Kind))}, got {kind!r}')
        self.project = nn.Linear(in_channels, channels)
        self.kind, self.pairs, self.temperature = kind, pairs, temperature
        self.near = NEAR * voxel_size

    def forward(self, batch: Batch, outputs: Encoded, labels: Any) -> dict[str, Tensor]:
        """The mean over the common points, then over the views; 0 where there is none."""
        first = self.project(outputs.features)
        terms = [0.0 * first.sum()]
        for view in batch.views:
            found = match_views(outputs.features, batch.xyz, batch.batch_offsets, view, self.pairs)
            if len(found.xyz):
                terms.append(self._compare(found))
        return {'loss_contrast': torch.stack(terms).sum() / max(len(terms) - 1, 1)}

    def _compare(self, found: Matches) -> Float[Tensor, '']:
        first, second, matching = self.project(found.first), self.project(found.second), found.distances() < self.near
        if self.kind == 'info_nce':
            return contrastive_loss(first, second, second, self.temperature, matching).mean()
        return hardest_contrastive_loss(F.normalize(first, dim=1), F.normalize(second, dim=1), ~matching)
