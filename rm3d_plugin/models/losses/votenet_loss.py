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
    trust: Float[Tensor, ' boxes'],
) -> Float[Tensor, '']:
    """Positives to their box, plus every box that holds a point to the nearest centre of its scene."""
    own = weighted_mean(_huber(centers[targets.positives], targets.code.centers), trust[targets.boxes])
    seen = torch.bincount(labels.instance[labels.instance >= 0], minlength=len(labels.boxes)) > 0
    if len(centers) == 0 or not bool(seen.any()):
        return own + 0.0 * centers.sum()
    gap = _huber(centers[None], labels.boxes[seen, None, :3])
    other = batch_index(labels.box_offsets)[seen][:, None] != batch_index(anchor_offsets)[None]
    nearest = gap.masked_fill(other, torch.inf).amin(dim=1)
    there = nearest.isfinite()
    return own + weighted_mean(nearest[there], trust[seen][there])


def box_losses(
    prediction: BoxPrediction,
    positives: Int[Tensor, ' positives'],
    code: BoxCode,
    trust: Float[Tensor, ' positives'],
) -> dict[str, Tensor]:
    """Heading and size of the positives, averaged by how far each is trusted, and their class, each alike."""
    rows = torch.arange(len(positives), device=positives.device)
    turn = prediction.heading_residuals[positives][rows, code.heading_bins]
    stretch = prediction.size_residuals[positives][rows, code.classes]
    ce = {
        'heading_bin': F.cross_entropy(prediction.heading_scores[positives], code.heading_bins, reduction='none'),
        'size_class': F.cross_entropy(prediction.size_scores[positives], code.classes, reduction='none'),
        'class': F.cross_entropy(prediction.class_scores[positives], code.classes, reduction='none'),
    }
    return {
        'heading_bin': 0.1 * weighted_mean(ce['heading_bin'], trust),
        'heading': weighted_mean(F.smooth_l1_loss(turn, code.heading_residuals, reduction='none'), trust),
        'size_class': 0.1 * weighted_mean(ce['size_class'], trust),
        'size': weighted_mean(F.smooth_l1_loss(stretch, code.size_residuals, reduction='none').mean(dim=1), trust),
        'class': 0.1 * weighted_mean(ce['class'], torch.ones_like(trust)),
    }


def proposal_losses(
    prediction: BoxPrediction,
    anchor_offsets: Int[Tensor, ' scenes_and_one'],
    targets: ProposalTargets,
    labels: BatchLabels,
    pseudo_geometry: float = 1.0,
) -> dict[str, Tensor]:
    """All terms of the proposals, with VoteNet's factors; ``pseudo_geometry`` as in :class:`VoteNetLoss`."""
    trust = torch.where(labels.box_is_annotated, 1.0, pseudo_geometry).to(prediction.centers)
    return {
        'objectness': 0.5 * objectness_loss(prediction.objectness, targets.is_object, targets.weights),
        'center': center_loss(prediction.centers, anchor_offsets, targets, labels, trust),
        **box_losses(prediction, targets.positives, targets.code, trust[targets.boxes]),
    }


@MODELS.register_module()
class VoteNetLoss(LossTerm):
    """VoteNet's own loss, term by term.

    10 (vote + .5 objectness + centre + .1 heading bin + heading + .1 size class + size + .1 class), METHOD 7.

    Args:
        loss_weight: The 10.
        vote_balance: See :func:`vote_targets`.
        pseudo_geometry: Weight of a pseudo box, against 1 of an annotated one, in what tells where exactly a box lies:
            centre, heading and size. 0: pseudo boxes say what is an object and of which class, annotated ones (seen
            again and again where they are pasted) how its box lies.

    Raises:
        ValueError: ``pseudo_geometry`` is negative.
    """

    needs = ('votes', 'targets')

    def __init__(self, loss_weight: float = 10.0, vote_balance: float = 0.5, pseudo_geometry: float = 1.0) -> None:
        super().__init__()
        if pseudo_geometry < 0:
            raise ValueError(f'VoteNetLoss.pseudo_geometry: expected 0 or more, got {pseudo_geometry}')
        self.loss_weight, self.vote_balance, self.pseudo_geometry = loss_weight, vote_balance, pseudo_geometry

    def forward(self, batch: Batch, outputs: DetectorOutput, labels: BatchLabels) -> dict[str, Tensor]:
        """``loss_vote``, ``loss_objectness``, ``loss_center`` and so on."""
        assert labels.targets is not None
        said = outputs.votes
        parts = {'vote': vote_loss(said.offsets, vote_targets(batch.xyz, labels, self.vote_balance))}
        parts.update(
            proposal_losses(said.prediction, said.anchor_offsets, labels.targets, labels, self.pseudo_geometry)
        )
        return {f'loss_{name}': self.loss_weight * value for name, value in parts.items()}
