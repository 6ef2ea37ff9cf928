"""Soft masks of the known instances of a batch (METHOD 7, L_Dice)."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.point_labels import PointLabels
from rm3d_plugin.models.losses.instance_offsets import instance_centroids
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import SegmentorOutput
from rm3d_plugin.ops.grouping import batch_index
from rm3d_plugin.registry import MODELS

SPREAD = 0.15  # m; half the distance from which METHOD 6 tells centres apart


class InstanceMask(NamedTuple):
    """One instance over the labelled points of its scene.

    Attributes:
        mask: (n,) p in [0, 1]: probability of its class times exp(-d^2 / (2 s^2)), d from shifted point to centroid.
        member: (n,) g, 1 for its points.
    """

    mask: Float[Tensor, ' points']
    member: Float[Tensor, ' points']


def soft_instance_masks(
    xyz: Float[Tensor, 'points 3'],
    offsets: Float[Tensor, 'points 3'],
    probs: Float[Tensor, 'points classes'],
    batch_offsets: Int[Tensor, ' scenes_and_one'],
    labels: PointLabels,
    spread: float = SPREAD,
) -> Iterator[InstanceMask]:
    """The mask of each instance; points without a label are left out, since nobody knows whether they belong.

    Args:
        xyz: Metres.
        offsets: Predicted, metres.
        probs: Softmax.
        batch_offsets: Rows of the scenes.
        labels: Instances, and the class of their points (their first one's, where they differ).
        spread: s in metres; larger: softer masks.
    """
    known = ((labels.semantic >= 0) | (labels.instance >= 0)).nonzero()[:, 0]
    scene = batch_index(batch_offsets)[known]
    centers = instance_centroids(xyz, labels.instance, len(labels.instance_scene))
    for number, owner in enumerate(labels.instance_scene.tolist()):
        rows = known[scene == owner]
        member = labels.instance[rows] == number
        kind = int(labels.semantic[rows[member][0]])
        if kind < 0:
            continue
        gap = (xyz[rows] + offsets[rows] - centers[number]).square().sum(dim=1)
        yield InstanceMask(probs[rows, kind] * torch.exp(-gap / (2.0 * spread**2)), member.float())


@MODELS.register_module()
class InstanceDice(LossTerm):
    """``loss_dice``: the soft mask of each known instance against its points; 0 where a batch has none.

    Args:
        loss: Config of a loss of mask and membership, called as ``DiceLoss`` is.
    """

    needs = ('logits', 'offsets', 'instance', 'instance_scene')

    def __init__(self, loss: dict[str, Any] | None = None) -> None:
        super().__init__()
        self.loss = MODELS.build({'type': 'DiceLoss', **(loss or {})})

    def forward(self, batch: Batch, outputs: SegmentorOutput, labels: PointLabels) -> dict[str, Tensor]:
        """``loss_dice``, the mean over the instances."""
        assert outputs.offsets is not None
        probs = outputs.logits.softmax(dim=1)
        masks = soft_instance_masks(batch.xyz, outputs.offsets, probs, batch.batch_offsets, labels)
        each = [self.loss(mask, member) for mask, member in masks]
        mean = torch.stack(each).mean() if each else 0.0 * (outputs.logits.sum() + outputs.offsets.sum())
        return {'loss_dice': mean}
