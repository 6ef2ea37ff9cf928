"""Offsets to instance centres, and instances by clustering (METHOD 7; PointGroup without its score network)."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from rm3d_plugin.models.backbones.layers import NormReLU
from rm3d_plugin.models.heads.point_labels import PointLabels
from rm3d_plugin.models.heads.proposals import Instances, ProposalRules, find_instances
from rm3d_plugin.ops.voxelize import gather_rows, sum_rows
from rm3d_plugin.registry import MODELS


class OffsetTargets(NamedTuple):
    """Where points of instances have to go.

    Attributes:
        rows: (K,) points that belong to an instance, ascending.
        offsets: (K, 3) metres from each to the centroid of its instance.
    """

    rows: Int[Tensor, ' known']
    offsets: Float[Tensor, 'known 3']


def instance_centroids(
    xyz: Float[Tensor, 'points 3'], instance: Int[Tensor, ' points'], count: int
) -> Float[Tensor, 'instances 3']:
    """Mean of the points of each instance, metres; zeros for one without points.

    Sums run in float64 and in the order of the points.
    """
    rows = (instance >= 0).nonzero()[:, 0]
    owner = instance[rows]
    sums = sum_rows(xyz[rows].double(), owner, count)
    sizes = torch.bincount(owner, minlength=count).clamp_min(1)
    return (sums / sizes[:, None]).to(xyz.dtype)


def offset_targets(
    xyz: Float[Tensor, 'points 3'], instance: Int[Tensor, ' points'], count: int, min_points: int = 1
) -> OffsetTargets:
    """Offsets from the points of instances to the centroid of all points of theirs that are in the batch.

    Args:
        xyz: Metres.
        instance: Instance of each point, numbered through the batch; -1 = none.
        count: Number of instances.
        min_points: An instance with fewer known points has no centre that could be taught.
    """
    sizes = torch.bincount(instance[instance >= 0], minlength=count)
    taught = (instance >= 0) & (sizes >= min_points)[instance.clamp_min(0)] if count else instance >= 0
    rows = taught.nonzero()[:, 0]
    centroids = instance_centroids(xyz, instance, count)
    return OffsetTargets(rows, centroids[instance[rows]] - xyz[rows])


@MODELS.register_module()
class PointGroupHead(nn.Module):
    """Offset branch and instance proposals.

    ::

        features -> linear m -> BN ReLU -> linear 3 -> offsets -> clusters of shifted and original points -> NMS

    Args:
        in_channels: Columns m of the features.
        offset_loss: Called as ``OffsetLoss`` is.
        min_instance_points: Instances with fewer labelled points in the batch teach no offset; 2 or more leaves out
            single clicks, whose own place says nothing about the centre.
        bn_eps: As in the backbone.
        bn_momentum: As in the backbone.
        proposals: Fields of :class:`ProposalRules`.
    """

    def __init__(
        self,
        in_channels: int,
        offset_loss: dict[str, Any] | None = None,
        min_instance_points: int = 1,
        bn_eps: float = 1e-4,
        bn_momentum: float = 0.1,
        proposals: dict[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.first = nn.Linear(in_channels, in_channels)
        self.norm = NormReLU(in_channels, bn_eps, bn_momentum)
        self.last = nn.Linear(in_channels, 3)
        self.min_instance_points = min_instance_points
        self.loss_part = MODELS.build({'type': 'OffsetLoss', **(offset_loss or {})})
        self.rules = ProposalRules(**(proposals or {}))

    def forward(self, features: Float[Tensor, 'points channels']) -> Float[Tensor, 'points 3']:
        """Offsets in metres, float32."""
        offsets: Tensor = self.last(self.norm(self.first(features)))
        return offsets.float()

    def loss(
        self, offsets: Float[Tensor, 'points 3'], xyz: Float[Tensor, 'points 3'], labels: PointLabels
    ) -> dict[str, Tensor]:
        """``loss_offset`` over the points of known instances; 0, with a gradient of 0, where there is none."""
        targets = offset_targets(xyz, labels.instance, len(labels.instance_scene), self.min_instance_points)
        return {'loss_offset': self.loss_part(gather_rows(offsets, targets.rows), targets.offsets)}

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
