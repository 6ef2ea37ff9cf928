"""Descriptors of two crops learn from each other (METHOD 3, Contrastive)."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple, get_args

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import View, common_rows
from rm3d_plugin.models.losses.descriptor_contrast import (
    distances,
    hardest_contrastive_loss,
    info_nce_loss,
    nearest_apart,
    pair_loss,
    place_distances,
    triplet_loss,
)
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.registry import MODELS

Contrast = Literal['triplet', 'pair', 'hardest', 'nce']
CONTRASTS: dict[Contrast, Callable[[Tensor, Tensor, Tensor], Tensor]] = {
    'triplet': triplet_loss,
    'pair': pair_loss,
    'hardest': hardest_contrastive_loss,
    'nce': info_nce_loss,
}


class SampledPairs(NamedTuple):
    """Places that both crops of a pair show.

    Attributes:
        first: (P,) rows of the batch's points.
        second: (P,) rows of the view's points.
        apart: (P, P) which places are no positives of each other, for they lie far apart or in different scans.
    """

    first: Int[Tensor, ' pairs']
    second: Int[Tensor, ' pairs']
    apart: Bool[Tensor, 'pairs pairs']


def sample_pairs(batch: Batch, view: View, count: int, least: float) -> SampledPairs:
    """Draw places that both crops show; the same for the same batch.

    Distances are measured within the first crop, whose coordinates are moved but not bent.

    Args:
        batch: The first crops.
        view: The second ones.
        count: How many; fewer where there are fewer.
        least: Places at least so far apart are negatives, in the unit of the coordinates.
    """
    second = common_rows(view.point_ids, count)
    first = view.point_ids[second]
    scene = torch.searchsorted(batch.batch_offsets, first, right=True)
    apart = (place_distances(batch.xyz[first], batch.xyz[first]) >= least) | (scene[:, None] != scene[None])
    return SampledPairs(first, second, apart)


@MODELS.register_module()
class PairContrast(LossTerm):
    """``loss_contrast`` between the first crops and each view, and ``matched``, logged only.

    ``matched`` is the share of the sampled places whose descriptor in the other crop is nearer than those of all
    places apart.

    Args:
        contrast: 'nce' (PointInfoNCE), 'triplet' (L_TriC, the paper's choice), 'pair' (L_C) or 'hardest' (that of
            FCGF).
        num_pairs: Places of a batch. Larger: harder negatives, memory with its square.
        negative_distance: Places at least so far apart are negatives, in voxels: 16 are about the 1 m of METHOD 3 in a
            room. A positive is a copy of the same point.
        loss_weight: Factor of the loss.
    """

    needs = ('features',)

    def __init__(
        self,
        contrast: Contrast = 'nce',
        num_pairs: int = 1024,
        negative_distance: float = 16.0,
        loss_weight: float = 1.0,
    ) -> None:
        super().__init__()
        if contrast not in CONTRASTS:
            raise ValueError(
                f'PairContrast.contrast: expected one of {", ".join(get_args(Contrast))}, got {contrast!r}'
            )
        self.contrast: Contrast = contrast
        self.num_pairs, self.negative_distance, self.loss_weight = num_pairs, negative_distance, loss_weight

    def forward(self, batch: Batch, outputs: Any, labels: Any) -> dict[str, Tensor]:
        """The mean over the views; {} where a batch has none."""
        losses, shares = [], []
        for view in batch.views:
            pairs = sample_pairs(batch, view, self.num_pairs, self.negative_distance)
            anchors, positives = outputs.features[pairs.first], view.features[pairs.second]
            losses.append(CONTRASTS[self.contrast](anchors, positives, pairs.apart))
            shares.append(matched_share(anchors.detach(), positives.detach(), pairs.apart))
        if not losses:
            return {}
        return {'loss_contrast': self.loss_weight * torch.stack(losses).mean(), 'matched': torch.stack(shares).mean()}


def matched_share(
    anchors: Float[Tensor, 'pairs channels'],
    positives: Float[Tensor, 'pairs channels'],
    apart: Bool[Tensor, 'pairs pairs'],
) -> Float[Tensor, '']:
    """Share of the anchors to which the own positive is nearer than that of every place apart."""
    gaps = distances(anchors, positives)
    return (gaps.diagonal() < nearest_apart(gaps, apart)).float().sum() / max(len(gaps), 1)
