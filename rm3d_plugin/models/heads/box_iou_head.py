"""How well a box fits: its expected overlap with the true one, from the points around it (3DIoUMatch, CVPR 2021)."""

import math
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from mmengine.model import BaseModule
from torch import Tensor, nn

from rm3d_plugin.models.heads.batch_labels import BatchLabels, FitPairs
from rm3d_plugin.models.heads.mlp import mlp
from rm3d_plugin.models.init_config import InitConfig
from rm3d_plugin.ops.boxes import rotated_iou_3d
from rm3d_plugin.ops.grouping import batch_index, gather_groups, group_max
from rm3d_plugin.registry import MODELS

_REACH = 1.4  # half sizes from the middle up to which points are read: a box that is too small shows points outside
_SLACK = 0.2  # m on top


class BoxSeeds(NamedTuple):
    """Points that the head reads.

    Attributes:
        xyz: (S, 3) metres.
        features: (S, F) of the backbone.
        offsets: (B + 1,) rows of the scenes.
    """

    xyz: Float[Tensor, 'seeds 3']
    features: Float[Tensor, 'seeds channels']
    offsets: Int[Tensor, ' scenes_and_one']


def in_box_frames(
    xyz: Float[Tensor, '#boxes points 3'], boxes: Float[Tensor, 'boxes 7']
) -> Float[Tensor, 'boxes points 3']:
    """Points in the axes of each box, metres from its middle."""
    gap = xyz - boxes[:, None, :3]
    c, s = boxes[:, 6].cos()[:, None], boxes[:, 6].sin()[:, None]
    return torch.stack([c * gap[..., 0] + s * gap[..., 1], c * gap[..., 1] - s * gap[..., 0], gap[..., 2]], dim=2)


def points_around(
    boxes: Float[Tensor, 'boxes 7'], box_offsets: Int[Tensor, ' scenes_and_one'], seeds: BoxSeeds, samples: int
) -> Int[Tensor, 'boxes samples']:
    """The first seeds in each box and a little around it, of its scene; -1 where there are fewer."""
    out = torch.full((len(boxes), samples), -1, dtype=torch.int64, device=boxes.device)
    ends, seed_ends = box_offsets.tolist(), seeds.offsets.tolist()
    for a, b, first, last in zip(ends[:-1], ends[1:], seed_ends[:-1], seed_ends[1:], strict=True):
        local = in_box_frames(seeds.xyz[None, first:last], boxes[a:b]).abs()
        inside = (local <= _REACH * 0.5 * boxes[a:b, None, 3:6] + _SLACK).all(dim=2)
        numbers = torch.where(inside, torch.arange(last - first, device=boxes.device), last - first)
        chosen = numbers.sort(dim=1).values[:, :samples]
        out[a:b, : chosen.shape[1]] = torch.where(chosen < last - first, chosen + first, -1)
    return out


def jittered(boxes: Float[Tensor, 'boxes 7'], amount: float) -> Float[Tensor, 'boxes 7']:
    """Boxes that are wrong by up to ``amount`` of their size in place and size, and of a quarter turn in yaw.

    Each draws its own share of that, so that overlaps of all sizes come.
    """
    share = amount * torch.rand(len(boxes), 1, device=boxes.device)
    noise = share * (2.0 * torch.rand(len(boxes), 7, device=boxes.device) - 1.0)
    return torch.cat(
        [
            boxes[:, :3] + noise[:, :3] * boxes[:, 3:6],
            boxes[:, 3:6] * noise[:, 3:6].exp(),
            boxes[:, 6:] + noise[:, 6:] * (0.5 * math.pi),
        ],
        dim=1,
    )


def own_overlaps(
    boxes: Float[Tensor, 'pairs 7'], owner: Int[Tensor, ' pairs'], truth: Float[Tensor, 'boxes 7']
) -> Float[Tensor, ' pairs']:
    """Overlap by volume of each box with the one that ``owner`` names."""
    given, true = boxes.detach().double().cpu().numpy(), truth.double().cpu().numpy()
    out = torch.zeros(len(boxes))
    for number in owner.unique().tolist():
        rows = (owner == number).cpu()
        out[rows] = torch.from_numpy(rotated_iou_3d(given[rows.numpy()], true[number : number + 1])[:, 0]).float()
    return out.to(boxes.device)


@MODELS.register_module()
class BoxIoUHead(BaseModule):
    """Expected overlap of any box with the object in it, from the seeds around it in the box's own axes.

    ::

        box, seeds -> places in half sizes, features -> MLP, max -+-> MLP -> log odds of the overlap
                                             size of the box -----+

    It learns from proposals and from annotated boxes that were made wrong on purpose, so a few labels show overlaps of
    all sizes. It has no gradient to the features.

    Args:
        in_channels: Features of a seed.
        hidden: Width of the MLPs.
        samples: Most seeds a box.
        copies: Wrong copies of each annotated box a step. Larger: slower, steadier.
        jitter: How wrong they are at most, in sizes.
        init_cfg: As in mmengine.
    """

    def __init__(
        self,
        in_channels: int,
        hidden: int = 64,
        samples: int = 24,
        copies: int = 6,
        jitter: float = 0.5,
        init_cfg: InitConfig = None,
    ) -> None:
        super().__init__(init_cfg)
        self.samples, self.copies, self.jitter = samples, copies, jitter
        self.point_mlp = mlp([in_channels + 3, hidden, hidden])
        self.box_mlp = mlp([hidden + 4, hidden])
        self.out = nn.Linear(hidden, 1)

    def forward(
        self, boxes: Float[Tensor, 'boxes 7'], box_offsets: Int[Tensor, ' scenes_and_one'], seeds: BoxSeeds
    ) -> Float[Tensor, ' boxes']:
        """Log odds of the overlap of each box.

        Args:
            boxes: Metres.
            box_offsets: Rows of the scenes among them.
            seeds: Points of the same scenes.
        """
        boxes = boxes.detach()
        members = points_around(boxes, box_offsets, seeds, self.samples)
        local = in_box_frames(gather_groups(seeds.xyz, members), boxes) / (0.5 * boxes[:, None, 3:6])
        grouped = torch.cat([local, gather_groups(seeds.features.detach(), members)], dim=2)
        pooled = group_max(self.point_mlp(grouped), members)
        filled = (members >= 0).float().mean(dim=1, keepdim=True)
        return self.out(self.box_mlp(torch.cat([pooled, boxes[:, 3:6].log(), filled], dim=1)))[:, 0].float()

    def pairs(
        self,
        boxes: Float[Tensor, 'proposals 7'],
        logits: Float[Tensor, ' proposals'],
        labels: BatchLabels,
        seeds: BoxSeeds,
    ) -> FitPairs:
        """What there is to learn: proposals near a box, and annotated boxes made wrong.

        Args:
            boxes: Decoded proposals.
            logits: What :meth:`forward` said of them.
            labels: Of the batch, with targets.
            seeds: Points of the same scenes.
        """
        assert labels.targets is not None
        near, own = labels.targets.positives, labels.targets.boxes
        truth = labels.boxes
        true_rows = labels.box_is_annotated.nonzero()[:, 0].repeat_interleave(self.copies)
        wrong = jittered(truth[true_rows], self.jitter)
        counts = torch.bincount(batch_index(labels.box_offsets)[true_rows], minlength=len(labels.box_offsets) - 1)
        offsets = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
        said = torch.cat([logits[near], self(wrong, offsets, seeds)])
        return FitPairs(said, own_overlaps(torch.cat([boxes[near], wrong]), torch.cat([own, true_rows]), truth))
