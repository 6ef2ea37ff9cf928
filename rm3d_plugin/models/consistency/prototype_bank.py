"""Prototypes: mean features of each class that follow the batches."""

from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from mmengine.dist import all_reduce
from torch import Tensor, nn


class GroupMeans(NamedTuple):
    """Means of groups of rows.

    Attributes:
        means: (G, D) mean feature of each group; 0 for one without a row.
        present: (G,) whether it has a row.
    """

    means: Float[Tensor, 'groups channels']
    present: Bool[Tensor, ' groups']


def group_means(features: Float[Tensor, 'rows channels'], groups: Int[Tensor, ' rows'], count: int) -> GroupMeans:
    """Mean of the features of each group; rows of group -1 are left out. Gradients flow to the features.

    >>> group_means(torch.tensor([[1.0], [3.0], [9.0]]), torch.tensor([0, 0, -1]), 2)
    GroupMeans(means=tensor([[2.],
            [0.]]), present=tensor([ True, False]))
    """
    totals, counts = _group_sums(features, groups, count)
    return GroupMeans(totals / counts.clamp_min(1.0)[:, None], counts > 0)


def _group_sums(features: Tensor, groups: Tensor, count: int) -> tuple[Tensor, Tensor]:
    known = groups >= 0
    features, groups = features[known].float(), groups[known]
    totals = features.new_zeros(count, features.shape[1]).index_add(0, groups, features)
    return totals, torch.bincount(groups, minlength=count).to(totals)


class PrototypeBank(nn.Module):
    """One or several prototypes a class, a running mean of features; in the checkpoint.

    Args:
        num_classes: C.
        channels: D.
        momentum: Share of the old prototype that stays at an update; larger: slower. The first rows of a prototype are
            taken as they are.
        per_class: K prototypes of each class.

    Attributes:
        values: (C, K, D) prototypes; 0 where there is none yet.
        present: (C, K) whether there is one.
    """

    values: Tensor
    present: Tensor

    def __init__(self, num_classes: int, channels: int, momentum: float = 0.999, per_class: int = 1) -> None:
        super().__init__()
        if not 0 <= momentum < 1 or per_class < 1:
            raise ValueError(
                f'PrototypeBank: expected momentum in [0, 1) and per_class >= 1, got {momentum} and {per_class}'
            )
        self.momentum = momentum
        self.register_buffer('values', torch.zeros(num_classes, per_class, channels))
        self.register_buffer('present', torch.zeros(num_classes, per_class, dtype=torch.bool))

    @torch.no_grad()
    def update(
        self,
        features: Float[Tensor, 'rows channels'],
        classes: Int[Tensor, ' rows'],
        slots: Int[Tensor, ' rows'] | None = None,
    ) -> None:
        """Move the prototypes of the classes that are there towards the means of their rows, over all processes.

        Args:
            features: Of points or regions.
            classes: -1: no class; the row is left out.
            slots: Which of the class's prototypes each row belongs to; None: the first.
        """
        per_class = self.present.shape[1]
        groups = classes * per_class + (0 if slots is None else slots)
        totals, counts = _group_sums(features, torch.where(classes >= 0, groups, classes), self.present.numel())
        all_reduce(totals)
        all_reduce(counts)
        values, present, seen = self.values.flatten(0, 1), self.present.flatten(), counts > 0
        means = totals[seen] / counts[seen][:, None]
        moved = torch.where(present[seen][:, None], values[seen].lerp(means, 1 - self.momentum), means)
        values[seen], present[seen] = moved, True  # views of the buffers

    def similarity(self, features: Float[Tensor, 'rows channels']) -> Float[Tensor, 'rows classes']:
        """Cosine of each row and the nearest prototype of each class; -inf for a class without any."""
        cosines = torch.einsum('nd,ckd->nck', F.normalize(features.float(), dim=1), F.normalize(self.values, dim=2))
        return cosines.masked_fill(~self.present, -torch.inf).amax(dim=2)
