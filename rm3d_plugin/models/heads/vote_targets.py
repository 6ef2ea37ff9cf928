"""What votes and proposals should say, where that is known."""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.heads.batch_labels import BatchLabels, ProposalTargets
from rm3d_plugin.models.heads.box_coder import encode_boxes
from rm3d_plugin.ops.grouping import batch_index


class VoteTargets(NamedTuple):
    """Targets of the points on (pseudo) objects.

    Attributes:
        points: (n,) rows of the batch's points.
        offsets: (n, 3) metres from each to the centre of its box.
        weights: (n,) sums to the number of objects.
    """

    points: Int[Tensor, ' points']
    offsets: Float[Tensor, 'points 3']
    weights: Float[Tensor, ' points']


def vote_targets(xyz: Float[Tensor, 'points 3'], labels: BatchLabels, balance: float = 0.5) -> VoteTargets:
    """Offsets of every point of a (pseudo) object to the centre of its box.

    Args:
        xyz: Points of the batch, metres.
        labels: Labels of the batch.
        balance: Weight of a point = (points of its object)^-balance: 0 counts points, 1 counts objects alike.
    """
    points = (labels.instance >= 0).nonzero()[:, 0]
    owner = labels.instance[points]
    counts = torch.bincount(owner, minlength=len(labels.boxes)).to(xyz)
    weights = counts.clamp_min(1.0).pow(-balance)[owner]
    weights = weights * ((counts > 0).sum() / weights.sum().clamp_min(1e-6))
    return VoteTargets(points, labels.boxes[owner, :3] - xyz[points], weights)


def known_share(
    members: Int[Tensor, 'proposals members'], labels: BatchLabels, background: int, unlabelled_weight: float
) -> Float[Tensor, ' proposals']:
    """How far "no object is here" is known of each proposal: the mean over its points.

    A point counts 1 if it is known background or belongs to a box (which then is elsewhere), ``unlabelled_weight`` if
    nothing is known of it. With every label known this is 1, VoteNet's rule.

    Args:
        members: Point rows of each proposal, -1 = none.
        labels: Labels of the batch.
        background: Its class number.
        unlabelled_weight: In [0, 1]. Larger: more negatives, some of them hidden objects.
    """
    known = (labels.semantic == background) | (labels.instance >= 0)
    worth = torch.where(known, 1.0, unlabelled_weight)
    there = members >= 0
    if len(worth) == 0:
        return torch.zeros(len(members), device=members.device)
    total = (worth[members.clamp_min(0)] * there).sum(dim=1)
    return total / there.sum(dim=1).clamp_min(1)


def box_distances(
    anchors: Float[Tensor, 'proposals 3'], anchor_offsets: Int[Tensor, ' scenes_and_one'], labels: BatchLabels
) -> Float[Tensor, 'proposals boxes']:
    """Metres from every proposal to every box centre; inf between scenes."""
    gap = torch.cdist(anchors.detach(), labels.boxes[:, :3], compute_mode='donot_use_mm_for_euclid_dist')
    other = batch_index(anchor_offsets)[:, None] != batch_index(labels.box_offsets)[None]
    return gap.masked_fill(other, torch.inf)


def proposal_targets(
    distances: Float[Tensor, 'proposals boxes'],
    known: Float[Tensor, ' proposals'],
    labels: BatchLabels,
    near: Float[Tensor, ' classes'],
    far: Float[Tensor, ' classes'],
    mean_sizes: Float[Tensor, 'classes 3'],
    heading_bins: int,
) -> ProposalTargets:
    """Assign proposals to boxes.

    Args:
        distances: From :func:`box_distances`.
        known: From :func:`known_share`.
        labels: Labels of the batch.
        near: Metres by class; a proposal within it is positive for the box it is nearest to (in units of ``near``).
        far: Metres by class; a proposal beyond it from every box is negative, one between is not judged.
        mean_sizes: Size templates, metres.
        heading_bins: NH.
    """
    if distances.shape[1] == 0:
        distances = distances.new_full((len(distances), 1), torch.inf)
        near_of, far_of = near[:1], far[:1]
    else:
        near_of, far_of = near[labels.classes], far[labels.classes]
    least, box = (distances / near_of).min(dim=1)
    is_object = least <= 1.0
    is_far = (distances > far_of).all(dim=1)
    weights = torch.where(is_object, 1.0, torch.where(is_far, known, 0.0))
    positives = is_object.nonzero()[:, 0]
    boxes = box[positives]
    code = encode_boxes(labels.boxes[boxes], labels.classes[boxes], mean_sizes, heading_bins)
    return ProposalTargets(is_object.long(), weights, positives, boxes, code)
