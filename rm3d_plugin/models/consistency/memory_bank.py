"""Features of earlier batches, kept by class: negatives of contrastive losses."""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn


class BankRows(NamedTuple):
    """Some features of a bank.

    Attributes:
        features: (M, D) of earlier batches, without gradients.
        classes: (M,) the class that each was kept under.
    """

    features: Float[Tensor, 'rows channels']
    classes: Int[Tensor, ' rows']


class MemoryBank(nn.Module):
    """A ring of features for each class; the oldest are overwritten. In the checkpoint, as a resumed run needs it.

    Args:
        num_classes: C.
        channels: D.
        size: Features of each class that are kept; C x size x D x 4 bytes in all.

    Attributes:
        values: (C, size, D).
        counts: (C,) features of each class that were ever put in.
    """

    values: Tensor
    counts: Tensor

    def __init__(self, num_classes: int, channels: int, size: int) -> None:
        super().__init__()
        if size < 1:
            raise ValueError(f'MemoryBank.size: expected at least 1, got {size}')
        self.register_buffer('values', torch.zeros(num_classes, size, channels))
        self.register_buffer('counts', torch.zeros(num_classes, dtype=torch.int64))

    @torch.no_grad()
    def put(self, features: Float[Tensor, 'rows channels'], classes: Int[Tensor, ' rows'], most: int) -> None:
        """Keep the first ``most`` rows of each class; rows of class -1 are left out."""
        size = self.values.shape[1]
        for number in range(len(self.counts)):
            rows = (classes == number).nonzero()[:, 0][: min(most, size)]
            places = (self.counts[number] + torch.arange(len(rows), device=rows.device)) % size
            self.values[number, places] = features[rows].to(self.values)
            self.counts[number] += len(rows)

    def draw(self, count: int) -> BankRows:
        """At most so many different rows, by torch's generator; fewer where the bank holds fewer."""
        held = self.counts.clamp_max(self.values.shape[1])
        filled = torch.arange(self.values.shape[1], device=held.device) < held[:, None]
        places = filled.flatten().nonzero()[:, 0]
        chosen = places[torch.randperm(len(places))[:count].to(places.device)]
        return BankRows(self.values.flatten(0, 1)[chosen], chosen // self.values.shape[1])
