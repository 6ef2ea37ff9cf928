"""Offsets to instance centres, and instances by clustering (METHOD 7; PointGroup without its score network)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from mmengine.model import BaseModule
from torch import Tensor, nn

from rm3d_plugin.models.backbones.layers import NormReLU
from rm3d_plugin.models.heads.proposals import Instances, ProposalRules, find_instances
from rm3d_plugin.models.init_config import InitConfig
from rm3d_plugin.registry import MODELS


@MODELS.register_module()
class PointGroupHead(BaseModule):
    """Offset branch and instance proposals.

    ::

        features -> linear m -> BN ReLU -> linear 3 -> offsets -> clusters of shifted and original points -> NMS

    Args:
        in_channels: Columns m of the features.
        bn_eps: As in the backbone.
        bn_momentum: As in the backbone.
        proposals: Fields of :class:`ProposalRules`.
        init_cfg: As in mmengine.
    """

    def __init__(
        self,
        in_channels: int,
        bn_eps: float = 1e-4,
        bn_momentum: float = 0.1,
        proposals: dict[str, Any] | None = None,
        init_cfg: InitConfig = None,
    ) -> None:
        super().__init__(init_cfg)
        self.first = nn.Linear(in_channels, in_channels)
        self.norm = NormReLU(in_channels, bn_eps, bn_momentum)
        self.last = nn.Linear(in_channels, 3)
        self.rules = ProposalRules(**(proposals or {}))

    def forward(self, features: Float[Tensor, 'points channels']) -> Float[Tensor, 'points 3']:
        """Offsets in metres, float32."""
        offsets: Tensor = self.last(self.norm(self.first(features)))
        return offsets.float()

    def instances(
        self,
        xyz: Float[Tensor, 'points 3'],
        offsets: Float[Tensor, 'points 3'],
        probs: Float[Tensor, 'points classes'],
        thing_classes: Sequence[int],
    ) -> Instances:
        """The instances of one scene; see :func:`find_instances`."""
        places, shifts = _numpy(xyz), _numpy(offsets)
        return find_instances(places, places + shifts, _numpy(probs), thing_classes, self.rules)


def _numpy(values: Tensor) -> Float[np.ndarray, 'points columns']:
    return values.detach().float().cpu().numpy()
