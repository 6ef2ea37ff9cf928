"""The small networks of heads."""

from collections.abc import Sequence

from torch import nn


def mlp(widths: Sequence[int]) -> nn.Sequential:
    """Linear, LayerNorm, ReLU for each step; rows do not depend on the rest of the batch."""
    steps: list[nn.Module] = []
    for a, b in zip(widths[:-1], widths[1:], strict=True):
        steps += [nn.Linear(a, b), nn.LayerNorm(b), nn.ReLU(inplace=True)]
    return nn.Sequential(*steps)
