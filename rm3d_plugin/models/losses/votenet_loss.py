"""The terms of VoteNet's loss; every one is 0 with a gradient path where nothing is known."""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.batch_labels import BatchLabels, ProposalTargets
from rm3d_plugin.models.heads.box_coder import BoxCode, BoxPrediction
from rm3d_plugin.models.heads.vote_targets import VoteTargets, vote_targets
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import DetectorOutput
from rm3d_plugin.ops.grouping import batch_index
from rm3d_plugin.registry import MODELS

_OBJECTNESS_WEIGHTS = (0.2, 0.8)  # METHOD 7: cross-entropy weights of no object, object
_EPS = 1e-6


def weighted_mean(values: Float[Tensor, ' rows'], weights: Float[Tensor, ' rows']) -> Float[Tensor, '']:
    """Sum of weighted values over the sum of weights; 0 where nothing has weight."""
    return (values * weights).sum() / weights.sum().clamp_min(_EPS)


def _mean(values: Tensor) -> Tensor:
    return values.sum() / max(values.numel(), 1)


def vote_loss(offsets: Float[Tensor, 'points 3'], targets: VoteTargets) -> Float[Tensor, '']:
    """Mean L1 distance (metres) between votes and centres, over the points of (pseudo) objects."""
    gap = (offsets[targets.points] - targets.offsets).abs().sum(dim=1)
    return weighted_mean(gap, targets.weights) + 0.0 * offsets.sum()


def objectness_loss(
    logits: Float[Tensor, 'proposals 2'], is_object: Int[Tensor, ' proposals'], weights: Float[Tensor, ' proposals']
) -> Float[Tensor, '']:
    """Cross-entropy with class weights .2 and .8, averaged over what is known of the proposals."""
    classes = logits.new_tensor(_OBJECTNESS_WEIGHTS)
    each = F.cross_entropy(logits, is_object, weight=classes, reduction='none')
    return weighted_mean(each, weights)


def _huber(a: Tensor, b: Tensor) -> Tensor:
    """Smooth L1 summed over x, y, z; a far miss pulls no harder than a near one."""
    a, b = torch.broadcast_tensors(a, b)
    return F.huber_loss(a, b, reduction='none').sum(dim=-1)


def center_loss(
    centers: Float[Tensor, 'proposals 3'],
    anchor_offsets: Int[Tensor, ' scenes_and_one'],
    targets: ProposalTargets,
    labels: BatchLabels,
) -> Float[Tensor, '']:
    """Positives to their box, plus every box that holds a point to the nearest centre of its scene."""
    own = _mean(_huber(centers[targets.positives], targets.code.centers))
    seen = torch.bincount(labels.instance[labels.instance >= 0], minlength=len(labels.boxes)) > 0
    if len(centers) == 0 or not bool(seen.any()):
        return own + 0.0 * centers.sum()
    gap = _huber(centers[None], labels.boxes[seen, None, :3])
    other = batch_index(labels.box_offsets)[seen][:, None] != batch_index(anchor_offsets)[None]
    nearest = gap.masked_fill(other, torch.inf).amin(dim=1)
    return own + _mean(nearest[nearest.isfinite()])


def box_losses(prediction: BoxPrediction, positives: Int[Tensor, ' positives'], code: BoxCode) -> dict[str, Tensor]:
    """Heading, size and class of the positives, each averaged over them."""
    rows = torch.arange(len(positives), device=positives.device)
    turn = prediction.heading_residuals[positives][rows, code.heading_bins]
    stretch = prediction.size_residuals[positives][rows, code.classes]
    ce = {
        'heading_bin': F.cross_entropy(prediction.heading_scores[positives], code.heading_bins, reduction='none'),
        'size_class': F.cross_entropy(prediction.size_scores[positives], code.classes, reduction='none'),
        'class': F.cross_entropy(prediction.class_scores[positives], code.classes, reduction='none'),
    }
    return {
        'heading_bin': 0.1 * _mean(ce['heading_bin']),
        'heading': _mean(F.smooth_l1_loss(turn, code.heading_residuals, reduction='none')),
        'size_class': 0.1 * _mean(ce['size_class']),
        'size': _mean(F.smooth_l1_loss(stretch, code.size_residuals, reduction='none')),
        'class': 0.1 * _mean(ce['class']),
    }


def proposal_losses(
    prediction: BoxPrediction,
    anchor_offsets: Int[Tensor, ' scenes_and_one'],
    targets: ProposalTargets,
    labels: BatchLabels,
) -> dict[str, Tensor]:
    """All terms of the proposals, with VoteNet's factors."""
    return {
        'objectness': 0.5 * objectness_loss(prediction.objectness, targets.is_object, targets.weights),
        'center': center_loss(prediction.centers, anchor_offsets, targets, labels),
        **box_losses(prediction, targets.positives, targets.code),
    }


@MODELS.register_module()
class VoteNetLoss(LossTerm):
    """VoteNet's own loss, term by term.

    10 (vote + .5 objectness + centre + .1 heading bin + heading + .1 size class + size + .1 class), METHOD 7.

    Args:
        loss_weight: The 10.
        vote_balance: See :func:`vote_targets`.
    """

    needs = ('votes', 'targets')

    def __init__(self, loss_weight: float = 10.0, vote_balance: float = 0.5) -> None:
        super().__init__()
        self.loss_weight, self.vote_balance = loss_weight, vote_balance

    def forward(self, batch: Batch, outputs: DetectorOutput, labels: BatchLabels) -> dict[str, Tensor]:
        """``loss_vote``, ``loss_objectness``, ``loss_center`` and so on."""
        assert labels.targets is not None
        said = outputs.votes
        parts = {'vote': vote_loss(said.offsets, vote_targets(batch.xyz, labels, self.vote_balance))}
        parts.update(proposal_losses(said.prediction, said.anchor_offsets, labels.targets, labels))
        return {f'loss_{name}': self.loss_weight * value for name, value in parts.items()}
