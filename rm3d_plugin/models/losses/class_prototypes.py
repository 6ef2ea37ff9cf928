"""Several prototypes of each class, to which points of labelled objects are assigned evenly (CPDet3D, CVPR 2025).

Points of a class look different on its faces and from afar, so one mean says little. Features of labelled points are
shared out among the prototypes of their class by optimal transport, and learn to be nearer to their own than to all
others. Only classes are learnt from it, no boxes.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.heads.batch_labels import BatchLabels
from rm3d_plugin.models.losses.loss_term import LossTerm
from rm3d_plugin.models.outputs import DetectorOutput
from rm3d_plugin.registry import MODELS


def even_assignment(
    similarity: Float[Tensor, 'points prototypes'], steps: int = 3, sharpness: float = 0.05
) -> Float[Tensor, 'points prototypes']:
    """Shares of each point in the prototypes, so that every prototype gets as many points as another (Sinkhorn).

    Args:
        similarity: Cosines.
        steps: Rounds of normalising columns and rows. Larger: more even.
        sharpness: Smaller: a point belongs to fewer prototypes.

    Returns:
        Rows that sum to 1.
    """
    shares = (similarity / sharpness - similarity.max() / sharpness).exp() if similarity.numel() else similarity
    for _ in range(steps):
        shares = shares / shares.sum(dim=0, keepdim=True).clamp_min(1e-12)
        shares = shares / shares.sum(dim=1, keepdim=True).clamp_min(1e-12)
    return shares


def prototype_loss(
    features: Float[Tensor, 'points channels'],
    own: Int[Tensor, ' points'],
    prototypes: Float[Tensor, 'prototypes channels'],
    temperature: float = 0.07,
) -> Float[Tensor, '']:
    """Mean cross-entropy of the cosines to all prototypes, the right one being ``own``; 0 for no point."""
    logits = F.normalize(features, dim=1) @ F.normalize(prototypes, dim=1).T / temperature
    return F.cross_entropy(logits, own, reduction='sum') / max(len(own), 1)


@MODELS.register_module()
class ClassPrototypes(LossTerm):
    """``loss_prototype``: points of labelled objects against the prototypes of all classes.

    Args:
        num_classes: Box classes.
        channels: Features of a point, as the backbone gives them.
        each: Prototypes a class.
        momentum: How much of a prototype stays in a step.
        points: Points a class and step, drawn at random; more: slower.
        loss_weight: Factor.
    """

    needs = ('features', 'semantic', 'instance')
    prototypes: Tensor

    def __init__(
        self,
        num_classes: int,
        channels: int,
        each: int = 4,
        momentum: float = 0.9,
        points: int = 128,
        loss_weight: float = 0.1,
    ) -> None:
        super().__init__()
        self.num_classes, self.each, self.momentum = num_classes, each, momentum
        self.points, self.loss_weight = points, loss_weight
        self.register_buffer('prototypes', F.normalize(torch.randn(num_classes * each, channels), dim=1))

    def forward(self, batch: Batch, outputs: DetectorOutput, labels: BatchLabels) -> dict[str, Tensor]:
        """``loss_prototype``."""
        kinds = torch.where(labels.instance >= 0, labels.semantic, -1)
        return {'loss_prototype': self.loss_weight * self.learn(outputs.features.float(), kinds)}

    def learn(self, features: Float[Tensor, 'points channels'], kinds: Int[Tensor, ' points']) -> Float[Tensor, '']:
        """The loss of a step; the prototypes move after it was computed.

        Args:
            features: Of all points.
            kinds: Class of each point on a labelled object; others do not count.
        """
        rows, own = self._assign(features.detach(), kinds)
        loss = prototype_loss(features[rows], own, self.prototypes.clone())
        self._move(features[rows].detach(), own)
        return loss + 0.0 * features.sum()

    def _assign(self, features: Tensor, kinds: Tensor) -> tuple[Tensor, Tensor]:
        """Rows of the points that count, and the prototype of each."""
        rows, own = [], []
        for kind in range(self.num_classes):
            found = (kinds == kind).nonzero()[:, 0]
            found = found[torch.randperm(len(found), device=found.device)[: self.points]]
            mine = self.prototypes[kind * self.each : (kind + 1) * self.each]
            shares = even_assignment(F.normalize(features[found], dim=1) @ mine.T)
            rows.append(found)
            own.append(kind * self.each + shares.argmax(dim=1))
        return torch.cat(rows), torch.cat(own)

    @torch.no_grad()
    def _move(self, features: Tensor, own: Tensor) -> None:
        """Each prototype moves to the mean direction of its points."""
        if not self.training:
            return
        sums = torch.zeros_like(self.prototypes).index_add_(0, own, F.normalize(features, dim=1))
        there = torch.bincount(own, minlength=len(sums)) > 0
        moved = self.momentum * self.prototypes + (1 - self.momentum) * F.normalize(sums, dim=1)
        self.prototypes[there] = F.normalize(moved, dim=1)[there]
