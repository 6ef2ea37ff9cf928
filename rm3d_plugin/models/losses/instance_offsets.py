"""Offsets to the centres of instances, learned from the points of known instances (METHOD 7, L_o)."""

from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.point_labels import PointLabels
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import SegmentorOutput
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
class InstanceOffsets(LossTerm):
    """``loss_offset`` over the points of known instances; 0, with a gradient of 0, where there is none.

    Args:
        loss: Config of a loss, called as ``OffsetLoss`` is.
        min_points: Instances with fewer labelled points in the batch teach no offset; 2 or more leaves out single
            clicks, whose own place says nothing about the centre.
    """

    needs = ('offsets', 'instance', 'instance_scene')

    def __init__(self, loss: dict[str, Any] | None = None, min_points: int = 1) -> None:
        super().__init__()
        self.loss = MODELS.build({'type': 'OffsetLoss', **(loss or {})})
        self.min_points = min_points

    def forward(self, batch: Batch, outputs: SegmentorOutput, labels: PointLabels) -> dict[str, Tensor]:
        """``loss_offset``."""
        assert outputs.offsets is not None
        targets = offset_targets(batch.xyz, labels.instance, len(labels.instance_scene), self.min_points)
        return {'loss_offset': self.loss(gather_rows(outputs.offsets, targets.rows), targets.offsets)}
