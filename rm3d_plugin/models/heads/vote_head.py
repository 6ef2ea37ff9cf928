"""VoteNet's head on a sparse U-Net: points vote, votes are grouped, groups become boxes (METHOD 7)."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from mmengine.model import BaseModule
from torch import Tensor, nn

from rm3d_plugin.models.heads.batch_labels import BatchLabels, ProposalTargets
from rm3d_plugin.models.heads.box_coder import BoxPrediction, prediction_width, split_prediction
from rm3d_plugin.models.heads.box_iou_head import BoxSeeds
from rm3d_plugin.models.heads.group_shape import SHAPE_CHANNELS, group_shape, membership
from rm3d_plugin.models.heads.mlp import mlp
from rm3d_plugin.models.heads.seeds import choose_seeds
from rm3d_plugin.models.heads.vote_targets import box_distances, known_share, proposal_targets
from rm3d_plugin.models.init_config import InitConfig
from rm3d_plugin.ops.grouping import ball_query, gather_groups, group_max
from rm3d_plugin.ops.sampling import furthest_point_sample_batch
from rm3d_plugin.registry import MODELS

_EPS = 1e-6  # where no vote around a proposal is foreground, all count alike


class VoteOutput(NamedTuple):
    """What the head computed for a batch.

    Attributes:
        offsets: (N, 3) metres from every point to where it votes its object's centre to be.
        anchors: (P, 3) proposals: the votes they were grouped around, metres.
        anchor_offsets: (B + 1,) rows of the scenes among the proposals.
        members: (P, K) point rows of the seeds grouped, -1 = none.
        prediction: The boxes.
        mean_sizes: (C, 3) the size templates that ``prediction`` is relative to, metres.
        seeds: The points that voted; None where nobody asks.
    """

    offsets: Float[Tensor, 'points 3']
    anchors: Float[Tensor, 'proposals 3']
    anchor_offsets: Int[Tensor, ' scenes_and_one']
    members: Int[Tensor, 'proposals members']
    prediction: BoxPrediction
    mean_sizes: Float[Tensor, 'classes 3']
    seeds: BoxSeeds | None = None


def _by_class(value: float | Sequence[float], num_classes: int, name: str) -> Tensor:
    values = [float(value)] * num_classes if isinstance(value, int | float) else [float(v) for v in value]
    if len(values) != num_classes or min(values) <= 0:
        raise ValueError(f'VoteHead.{name}: expected a positive length or {num_classes} of them, got {value}')
    return torch.tensor(values)


@MODELS.register_module()
class VoteHead(BaseModule):
    """Votes and proposals.

    ::

        features -> vote MLP -> offsets of all points
                       seeds +-> feature residuals -> votes -> FPS -> mean shift -> ball -> MLP, max -+-> MLP -> boxes
                                                                                      +-> shape, MLP -+

    Layer instead of batch normalisation: a batch of one scene on a small machine trains as well, and training and
    prediction compute the same.

    Args:
        in_channels: Features of a point.
        num_classes: Box classes C.
        mean_sizes: (C, 3) size templates in metres (length, width, height); ones until :meth:`set_mean_sizes`.
        heading_bins: NH: 12 for oriented boxes, 1 for axis-aligned ones.
        num_seeds: Points of each scene that vote for proposals. Larger: small and far objects are seen, slower.
        num_proposals: Proposals a scene.
        hidden: Width of the MLPs.
        radius: Metres around a proposal in which votes are grouped; about .3 indoors, 1.2 for cars.
        samples: Most votes a group.
        near: Metres (one, or one a class) within which a proposal is an object.
        far: Metres (one, or one a class) beyond which it is none.
        seed_threshold: Predicted foreground probability from which a point is preferred as seed. Larger: fewer
            doubtful points.
        unlabelled_weight: See :func:`known_share`.
        mean_shifts: Steps that move a proposal to the mean of the votes around it; 0 = VoteNet's proposals.
        init_cfg: As in mmengine.
    """

    mean_sizes: Tensor
    near: Tensor
    far: Tensor
    judged = False  # as LabelStatistics has it; then unlabelled_weight is not asked

    def __init__(
        self,
        in_channels: int,
        num_classes: int,
        mean_sizes: Sequence[Sequence[float]] | None = None,
        heading_bins: int = 12,
        num_seeds: int = 256,
        num_proposals: int = 96,
        hidden: int = 64,
        radius: float = 0.3,
        samples: int = 16,
        near: float | Sequence[float] = 0.3,
        far: float | Sequence[float] = 0.6,
        seed_threshold: float = 0.2,
        unlabelled_weight: float = 0.0,
        mean_shifts: int = 1,
        init_cfg: InitConfig = None,
    ) -> None:
        super().__init__(init_cfg)
        self.num_classes, self.heading_bins = num_classes, heading_bins
        self.num_seeds, self.num_proposals = num_seeds, num_proposals
        self.radius, self.samples = radius, samples
        self.seed_threshold, self.unlabelled_weight = seed_threshold, unlabelled_weight
        self.mean_shifts = mean_shifts
        self.register_buffer('mean_sizes', torch.ones(num_classes, 3))
        self.register_buffer('near', _by_class(near, num_classes, 'near'), persistent=False)
        self.register_buffer('far', _by_class(far, num_classes, 'far'), persistent=False)
        if mean_sizes is not None:
            self.set_mean_sizes(torch.tensor(mean_sizes))
        self.vote_mlp = mlp([in_channels, hidden, hidden])
        self.vote_offset = nn.Linear(hidden, 3)
        self.vote_residual = nn.Linear(hidden, in_channels)
        self.group_mlp = mlp([in_channels + 6, hidden, hidden, 2 * hidden])
        self.shape_mlp = mlp([SHAPE_CHANNELS, hidden, hidden])
        self.box_mlp = mlp([3 * hidden, 2 * hidden, 2 * hidden])
        self.box_out = nn.Linear(2 * hidden, prediction_width(heading_bins, num_classes))

    @torch.no_grad()
    def set_mean_sizes(self, sizes: Float[Tensor, 'classes 3']) -> None:
        """Set the size templates (metres), say to the means of the annotated boxes; they are kept in the checkpoint.

        Raises:
            ValueError: The shape does not fit, or a size is not positive.
        """
        if sizes.shape != self.mean_sizes.shape or not bool((sizes > 0).all()):
            raise ValueError(f'VoteHead.mean_sizes: expected positive ({self.num_classes}, 3), got {sizes.tolist()}')
        self.mean_sizes.copy_(sizes)

    def forward(
        self,
        xyz: Float[Tensor, 'points 3'],
        features: Float[Tensor, 'points channels'],
        foreground: Float[Tensor, ' points'],
        batch_offsets: Int[Tensor, ' scenes_and_one'],
    ) -> VoteOutput:
        """Votes of all points, boxes of the proposals.

        Args:
            xyz: Metres.
            features: From the backbone.
            foreground: Predicted probability that a point lies on an object; ranks and weighs points, without gradient.
            batch_offsets: Rows of the scenes.
        """
        foreground = foreground.detach()
        hidden = self.vote_mlp(features)
        offsets = self.vote_offset(hidden).float()
        seeds, seed_offsets = choose_seeds(xyz, foreground, batch_offsets, self.num_seeds, self.seed_threshold)
        votes = xyz[seeds] + offsets[seeds]
        vote_features = features[seeds] + self.vote_residual(hidden[seeds])
        rows, anchor_offsets = furthest_point_sample_batch(votes, seed_offsets, self.num_proposals)
        anchors = self._shift(votes[rows], votes, foreground[seeds], anchor_offsets, seed_offsets)
        groups = ball_query(votes, anchors, self.radius, self.samples, seed_offsets, anchor_offsets)
        prediction = self._boxes(groups, anchors, votes, xyz[seeds], vote_features, foreground[seeds])
        members = torch.where(groups >= 0, seeds[groups.clamp_min(0)], -1) if len(seeds) else groups
        voted = BoxSeeds(xyz[seeds], features[seeds], seed_offsets)
        return VoteOutput(offsets, anchors, anchor_offsets, members, prediction, self.mean_sizes, voted)

    def _shift(
        self, anchors: Tensor, votes: Tensor, foreground: Tensor, anchor_offsets: Tensor, vote_offsets: Tensor
    ) -> Tensor:
        """Move proposals to where the votes around them agree: furthest point sampling starts them at the fringe."""
        for _ in range(self.mean_shifts):
            groups = ball_query(votes, anchors, self.radius, self.samples, vote_offsets, anchor_offsets)
            near = gather_groups(votes, groups)
            local = (near - anchors[:, None]).detach() / self.radius
            weights = membership(local, gather_groups(foreground[:, None], groups)[..., 0], groups) + _EPS * (
                groups >= 0
            )
            anchors = (near * weights[..., None]).sum(dim=1) / weights.sum(dim=1, keepdim=True)
        return anchors

    def _boxes(
        self, groups: Tensor, anchors: Tensor, votes: Tensor, seeds: Tensor, features: Tensor, foreground: Tensor
    ) -> BoxPrediction:
        """Boxes of the groups, from features of their votes and from the shape that their seeds outline."""
        local = (gather_groups(votes, groups) - anchors[:, None]) / self.radius
        surface = (gather_groups(seeds, groups) - anchors[:, None]) / self.radius
        grouped = torch.cat([local, surface, gather_groups(features, groups)], dim=2)
        pooled = group_max(self.group_mlp(grouped), groups)
        weights = membership(local, gather_groups(foreground[:, None], groups)[..., 0], groups)
        outline = self.shape_mlp(group_shape(surface, weights))
        raw = self.box_out(self.box_mlp(torch.cat([pooled, outline], dim=1)))
        return split_prediction(raw.float(), anchors, self.heading_bins)

    def targets(self, output: VoteOutput, labels: BatchLabels) -> ProposalTargets:
        """Assignment of the proposals to the boxes of their scenes."""
        unlabelled = 0.0 if self.judged else self.unlabelled_weight
        known = known_share(output.members, labels, self.num_classes, unlabelled)
        distances = box_distances(output.anchors, output.anchor_offsets, labels)
        return proposal_targets(distances, known, labels, self.near, self.far, self.mean_sizes, self.heading_bins)
