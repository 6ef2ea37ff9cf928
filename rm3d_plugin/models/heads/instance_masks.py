"""Soft masks of proposals over the points around their object (METHOD 7, L_Dice)."""

from collections.abc import Iterator
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rm3d_plugin.models.heads.batch_labels import BatchLabels
from rm3d_plugin.models.heads.vote_head import VoteOutput
from rm3d_plugin.models.heads.vote_targets import ProposalTargets
from rm3d_plugin.ops.grouping import batch_index

_REACH = 2.0  # class radii; points further from the box have a mask of about 0 anyway


class InstanceMasks(NamedTuple):
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


def instance_masks(
    xyz: Float[Tensor, 'points 3'],
    batch_offsets: Int[Tensor, ' scenes_and_one'],
    point_probs: Float[Tensor, 'points classes_and_one'],
    output: VoteOutput,
    targets: ProposalTargets,
    labels: BatchLabels,
    mean_sizes: Float[Tensor, 'classes 3'],
) -> Iterator[InstanceMasks]:
    """The masks of each object that has positive proposals and points, over the points near it whose label is known."""
    scene, radii = batch_index(batch_offsets), class_radii(mean_sizes)
    box_scene, known = batch_index(labels.box_offsets), _known(labels)
    votes = xyz + output.offsets
    centers = output.prediction.centers
    for box in targets.boxes.unique().tolist():
        kind = labels.classes[box]
        near = (xyz - labels.boxes[box, :3]).norm(dim=1) <= _REACH * radii[kind]
        rows = (near & known & (scene == box_scene[box])).nonzero()[:, 0]
        member = (labels.instance[rows] == box).float()
        if not bool(member.any()):
            continue
        own = targets.positives[targets.boxes == box]
        yield InstanceMasks(soft_mask(point_probs[rows, kind], votes[rows], centers[own], radii[kind]), member)
