"""What the coarse places of a crop learn from each other and from those of the other crop (METHOD 3, Predator)."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

NEIGHBORS = 10  # METHOD 3: of the graph convolution


class EdgeConv(nn.Module):
    """Graph convolution (DGCNN, Wang et al. 2019): the most of ``relu(W [x_i, x_j - x_i])`` over the nearest places.

    Args:
        channels: Columns in and out.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(2 * channels, channels)
        self.norm = nn.LayerNorm(channels)

    def forward(self, values: Float[Tensor, 'sites channels'], near: Int[Tensor, 'sites k']) -> Tensor:
        """The values, and what their neighbours add.

        Args:
            values: Of each place.
            near: Rows of its nearest places, itself among them.
        """
        around = values[near]
        own = values[:, None].expand_as(around)
        return self.norm(values + self.linear(torch.cat([own, around - own], dim=2)).relu().amax(1))


class CrossAttention(nn.Module):
    """Multi-head attention of the places of one crop to those of the other (Vaswani et al. 2017), and a residual.

    Args:
        channels: Columns in and out, a multiple of the heads.
        heads: METHOD 3: four.
    """

    def __init__(self, channels: int, heads: int = 4) -> None:
        super().__init__()
        self.attention = nn.MultiheadAttention(channels, heads, batch_first=True)
        self.merge = nn.Sequential(nn.Linear(2 * channels, channels), nn.ReLU(), nn.Linear(channels, channels))
        self.norm = nn.LayerNorm(channels)

    def forward(self, values: Float[Tensor, 'sites channels'], other: Float[Tensor, 'others channels']) -> Tensor:
        """The values, and what they take from the other crop."""
        message = self.attention(values[None], other[None], other[None], need_weights=False)[0][0]
        return self.norm(values + self.merge(torch.cat([values, message], dim=1)))


class OverlapAttention(nn.Module):
    """Graph convolution, cross attention, graph convolution; then how likely each place lies in the overlap.

    ::

        coarse -> linear -> EdgeConv -> cross attention -> EdgeConv -> score, score of the best places of the other crop
        coarse <- linear <-------------- concat ------------------------------------------------------------+

    Args:
        in_channels: Columns of the coarsest level of the backbone.
        channels: Columns within; 256 in Predator.
        heads: Of the attention.
    """

    def __init__(self, in_channels: int, channels: int = 64, heads: int = 4) -> None:
        super().__init__()
        self.enter = nn.Linear(in_channels, channels)
        self.before, self.after = EdgeConv(channels), EdgeConv(channels)
        self.cross = CrossAttention(channels, heads)
        self.score = nn.Linear(channels, 1)
        self.temperature = nn.Parameter(torch.tensor(0.1))
        self.leave = nn.Linear(channels + 2, in_channels)

    def forward(
        self,
        values: Float[Tensor, 'sites channels'],
        coords: Int[Tensor, 'sites 4'],
        partners: Int[Tensor, ' scenes'],
    ) -> Float[Tensor, 'sites channels']:
        """New values of the coarse places.

        Args:
            values: Of the coarse voxels of a batch.
            coords: Their scene, x, y and z; sorted by scene.
            partners: The scene that is the other crop of each; itself where there is one crop.
        """
        bounds = torch.bincount(coords[:, 0], minlength=len(partners)).cumsum(0).tolist()
        parts = [slice(start, stop) for start, stop in zip([0, *bounds[:-1]], bounds, strict=True)]
        places = coords[:, 1:].to(values.dtype)
        near = [_nearest(places[part]) for part in parts]
        hidden = self.enter(values)
        first = [self.before(hidden[part], rows) for part, rows in zip(parts, near, strict=True)]
        met = [self.cross(own, first[other]) for own, other in zip(first, partners.tolist(), strict=True)]
        second = [self.after(own, rows) for own, rows in zip(met, near, strict=True)]
        scores = [self.score(own) for own in second]
        out = []
        for own, score, other in zip(second, scores, partners.tolist(), strict=True):
            alike = own @ second[other].T / (own.shape[1] ** 0.5 * self.temperature.abs().clamp_min(0.02))
            out.append(torch.cat([own, score, alike.softmax(1) @ scores[other]], dim=1))
        return values + self.leave(torch.cat(out))


def _nearest(places: Float[Tensor, 'sites 3']) -> Int[Tensor, 'sites k']:
    gaps = torch.cdist(places, places, compute_mode='donot_use_mm_for_euclid_dist')
    return gaps.sort(dim=1, stable=True).indices[:, :NEIGHBORS]
