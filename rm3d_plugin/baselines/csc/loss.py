"""Contrastive Scene Contexts: points are told apart within parts of the space around them (Hou et al., CVPR 2021)."""

from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.losses import LossTerm, contrastive_loss
from rm3d_plugin.models.pretraining import Encoded, Matches, match_views
from rm3d_plugin.registry import MODELS


def space_groups(xyz: Float[Tensor, 'points 3'], inner: float, outer: float) -> Bool[Tensor, 'groups points points']:
    """Which points lie in which part of the space around a point: the released code's partition in four.

    The parts are (inner, outer] and beyond, each above the point or not above it. What is nearer than ``inner`` lies
    in none.

    Args:
        xyz: Of one scene, metres, z up.
        inner: Metres.
        outer: Metres.

    >>> places = torch.tensor([[0.0, 0, 0], [0, 0, 3], [0, 1, 0]])
    >>> space_groups(places, 2.0, 20.0)[:, 0].int().tolist()
    [[0, 1, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    """
    away = torch.cdist(xyz, xyz)
    above = xyz[:, 2] > xyz[:, 2:]
    middle, far = (away > inner) & (away <= outer), away > outer
    return torch.stack([middle & above, middle & ~above, far & above, far & ~above])


@MODELS.register_module()
class SceneContexts(LossTerm):
    """``loss_contexts``: a contrastive loss for each part of the space around points, averaged over parts and scenes.

    Args:
        in_channels: Features of the backbone.
        channels: Of the projection that is compared; it is dropped afterwards.
        pairs: Most common points of a batch; 4096 a scene in the released script.
        inner: Metres around a point in which no other is a negative.
        outer: Metres where the next parts begin; 20 in the released script: in a room there is nothing beyond.
        temperature: Smaller: near negatives count more.
    """

    needs = ('features',)

    def __init__(
        self,
        in_channels: int,
        channels: int = 32,
        pairs: int = 4096,
        inner: float = 2.0,
        outer: float = 20.0,
        temperature: float = 0.4,
    ) -> None:
        super().__init__()
        if not 0 <= inner < outer:
            raise ValueError(f'SceneContexts: expected inner below outer, in metres, got {inner} and {outer}')
        self.project = nn.Linear(in_channels, channels)
        self.pairs, self.inner, self.outer, self.temperature = pairs, inner, outer, temperature

    def forward(self, batch: Batch, outputs: Encoded, labels: Any) -> dict[str, Tensor]:
        """The loss; 0 where views have no point in common."""
        terms = [0.0 * self.project(outputs.features).sum()]
        for view in batch.views:
            found = match_views(outputs.features, batch.xyz, batch.batch_offsets, view, self.pairs)
            terms += [self._compare(found.of_scene(number)) for number in found.scene.unique().tolist()]
        return {'loss_contexts': torch.stack(terms).sum() / max(len(terms) - 1, 1)}

    def _compare(self, found: Matches) -> Tensor:
        """Mean over points and parts of one scene."""
        first, second = self.project(found.first), self.project(found.second)
        parts = space_groups(found.xyz, self.inner, self.outer)
        each = [contrastive_loss(first, second, second, self.temperature, ~part).mean() for part in parts]
        return torch.stack(each).mean()
