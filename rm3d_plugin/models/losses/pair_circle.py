"""What Predator learns from a pair of crops: descriptors, overlap, and which places are matched (METHOD 3)."""

from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import View
from rm3d_plugin.models.losses.circle import balanced_bce, circle_loss
from rm3d_plugin.models.losses.descriptor_contrast import distances, place_distances
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.losses.pair_contrast import SampledPairs, sample_pairs
from rm3d_plugin.registry import MODELS

EASY = 0.3  # share of matched places from which saliency is taught; before, it would learn noise


@MODELS.register_module()
class PairCircle(LossTerm):
    """``loss_circle``, ``loss_overlap`` and ``loss_saliency`` of a network that says all three, and ``matched``.

    Lengths are in voxels: METHOD's at 2.5 cm a voxel.

    Args:
        num_pairs: Places of a batch whose descriptors are compared.
        positive_radius: Places nearer than this are one place, and what lies so near to a copied point overlaps.
        safe_radius: Places farther than this are apart.
        match_radius: A match so far off is correct.
    """

    needs = ('features', 'overlap', 'saliency', 'other')

    def __init__(
        self,
        num_pairs: int = 256,
        positive_radius: float = 1.5,
        safe_radius: float = 4.0,
        match_radius: float = 2.0,
    ) -> None:
        super().__init__()
        self.num_pairs, self.positive_radius = num_pairs, positive_radius
        self.safe_radius, self.match_radius = safe_radius, match_radius

    def forward(self, batch: Batch, outputs: Any, labels: Any) -> dict[str, Tensor]:
        """Of the first crops and the first view; {} where a batch has none."""
        if not batch.views:
            return {}
        view, other = batch.views[0], outputs.other
        pairs = sample_pairs(batch, view, self.num_pairs, self.safe_radius)
        gaps = distances(outputs.features[pairs.first], other.features[pairs.second])
        near = place_distances(batch.xyz[pairs.first], batch.xyz[pairs.first]) < self.positive_radius
        correct = self._correct(batch, view, outputs, pairs)
        matched = correct.float().sum() / max(len(correct), 1)
        return {
            'loss_circle': circle_loss(gaps, near & ~pairs.apart, pairs.apart),
            'loss_overlap': self._overlap(batch, view, outputs),
            'loss_saliency': balanced_bce(outputs.saliency[pairs.first], correct) * (matched > EASY),
            'matched': matched,
        }

    def _overlap(self, batch: Batch, view: View, outputs: Any) -> Float[Tensor, '']:
        """Cross entropy of the overlap scores of all sites of both crops."""
        copied = view.point_ids >= 0
        own = torch.zeros(len(batch.xyz), dtype=torch.bool, device=copied.device)
        own[view.point_ids[copied]] = True
        first = beside(batch.xyz, batch.batch_offsets, own, self.positive_radius)
        second = beside(view.points[:, :3], view.batch_offsets, copied, self.positive_radius)
        return balanced_bce(torch.cat([outputs.overlap, outputs.other.overlap]), torch.cat([first, second]))

    def _correct(self, batch: Batch, view: View, outputs: Any, pairs: SampledPairs) -> Bool[Tensor, ' pairs']:
        """Which sampled places find their own surroundings among all copied points of their scan's other crop."""
        rows = torch.nonzero(view.point_ids >= 0)[:, 0]
        with torch.no_grad():
            gaps = distances(outputs.features[pairs.first], outputs.other.features[rows])
        homes = view.point_ids[rows]
        scenes = [torch.searchsorted(batch.batch_offsets, ids, right=True) for ids in (pairs.first, homes)]
        gaps = gaps.masked_fill(scenes[0][:, None] != scenes[1][None], torch.inf)
        if not gaps.numel():
            return torch.zeros(len(pairs.first), dtype=torch.bool, device=gaps.device)
        found = homes[gaps.argmin(1)]
        return (batch.xyz[found] - batch.xyz[pairs.first]).norm(dim=1) <= self.match_radius


def beside(
    xyz: Float[Tensor, 'points 3'],
    batch_offsets: Int[Tensor, ' scenes_and_one'],
    chosen: Bool[Tensor, ' points'],
    radius: float,
) -> Bool[Tensor, ' points']:
    """Which points lie within a radius of a chosen one of their scene."""
    out = torch.zeros_like(chosen)
    for start, stop in zip(batch_offsets[:-1].tolist(), batch_offsets[1:].tolist(), strict=True):
        here, wanted = xyz[start:stop], chosen[start:stop]
        if bool(wanted.any()):
            out[start:stop] = place_distances(here, here[wanted]).amin(1) <= radius
    return out
