"""Soft masks of proposals over the points around their object (METHOD 7, L_Dice)."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.batch_labels import BatchLabels
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import DetectorOutput
from rm3d_plugin.ops.grouping import batch_index
from rm3d_plugin.registry import MODELS

_REACH = 2.0  # class radii; points further from the box have a mask of about 0 anyway


class ProposalMasks(NamedTuple):
    """Masks of the positive proposals of one object.

    Attributes:
        mask: (K, n) p in [0, 1].
        member: (n,) g, 1 for the points of the object.
    """

    mask: Float[Tensor, 'proposals points']
    member: Float[Tensor, ' points']


def class_radii(mean_sizes: Float[Tensor, 'classes 3']) -> Float[Tensor, ' classes']:
    """Half the diagonal of each size template seen from above, metres."""
    return 0.5 * mean_sizes[:, :2].norm(dim=1)


def soft_mask(
    class_probs: Float[Tensor, ' points'],
    votes: Float[Tensor, 'points 3'],
    centers: Float[Tensor, 'proposals 3'],
    radius: Float[Tensor, ''] | float,
) -> Float[Tensor, 'proposals points']:
    """Membership p = P_out(class) exp(-|vote - centre|^2 / (2 s^2)), s half the class radius (metres)."""
    gap = (centers[:, None] - votes[None]).square().sum(dim=2)
    return class_probs * torch.exp(-gap / (2.0 * (0.5 * radius) ** 2))


def _known(labels: BatchLabels) -> Bool[Tensor, ' points']:
    return (labels.semantic >= 0) | (labels.instance >= 0)


def proposal_masks(batch: Batch, outputs: DetectorOutput, labels: BatchLabels) -> Iterator[ProposalMasks]:
    """The masks of each object that has positive proposals and points, over the points near it whose label is known."""
    assert labels.targets is not None
    probs, votes, targets = outputs.logits.softmax(dim=1), outputs.votes, labels.targets
    scene, radii = batch_index(batch.batch_offsets), class_radii(votes.mean_sizes)
    box_scene, known = batch_index(labels.box_offsets), _known(labels)
    voted = batch.xyz + votes.offsets
    for box in targets.boxes.unique().tolist():
        kind = labels.classes[box]
        near = (batch.xyz - labels.boxes[box, :3]).norm(dim=1) <= _REACH * radii[kind]
        rows = (near & known & (scene == box_scene[box])).nonzero()[:, 0]
        member = (labels.instance[rows] == box).float()
        if not bool(member.any()):
            continue
        own = targets.positives[targets.boxes == box]
        mask = soft_mask(probs[rows, kind], voted[rows], votes.prediction.centers[own], radii[kind])
        yield ProposalMasks(mask, member)


@MODELS.register_module()
class ProposalDice(LossTerm):
    """``loss_dice``: the soft masks of positive proposals against the points of their object; 0 where there is none.

    Args:
        loss: Config of a loss of masks and membership, called as ``DiceLoss`` is.
    """

    needs = ('logits', 'votes', 'targets')

    def __init__(self, loss: dict[str, Any] | None = None) -> None:
        super().__init__()
        self.loss = MODELS.build({'type': 'DiceLoss', **(loss or {})})

    def forward(self, batch: Batch, outputs: DetectorOutput, labels: BatchLabels) -> dict[str, Tensor]:
        """``loss_dice``, the mean over the objects that have a positive proposal."""
        masks = proposal_masks(batch, outputs, labels)
        each = [self.loss(mask, member.expand_as(mask)) for mask, member in masks]
        return {'loss_dice': torch.stack(each).mean() if each else 0.0 * outputs.logits.sum()}
