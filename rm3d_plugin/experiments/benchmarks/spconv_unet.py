"""The same U-Net in spconv, where that is installed: what our layers are compared with."""

from collections.abc import Callable, Sequence

import spconv.pytorch as spconv
import torch
from spconv.pytorch import ops
from torch import Tensor, nn


def jobs(
    coords: Tensor, features: Tensor, channels: Sequence[int], blocks: int, backward: bool, conv_rows: Tensor
) -> dict[str, Callable[[], object]]:
    """Timed jobs; spconv wants int32 coordinates from zero and finds its pairs anew for every tensor, as ours do."""
    indices = torch.cat([coords[:, :1], coords[:, 1:] - coords[:, 1:].min(dim=0).values], dim=1).int()
    shape = (indices[:, 1:].max(dim=0).values + 1).tolist()
    net = _Net(features.shape[1], channels, blocks)
    if not features.is_cuda:
        ops.get_current_stream = lambda: 0  # asks CUDA even where all tensors are on the CPU; backward fails

    def forward() -> Tensor:
        return net(spconv.SparseConvTensor(features, indices, shape, 1))

    def forward_only() -> Tensor:
        with torch.no_grad():
            return forward()

    def forward_backward() -> None:
        net.zero_grad()
        forward().square().mean().backward()

    width = conv_rows.shape[1]
    layer = spconv.SubMConv3d(width, width, 3, bias=False, indice_key='one')

    def conv(tensor: spconv.SparseConvTensor) -> Tensor:
        with torch.no_grad():
            return layer(tensor).features

    mapped = layer(spconv.SparseConvTensor(conv_rows, indices, shape, 1)).replace_feature(conv_rows)  # with its pairs
    found: dict[str, Callable[[], object]] = {
        'spconv_forward_s': forward_only,
        'spconv_conv_s': lambda: conv(mapped),
        'spconv_conv_with_map_s': lambda: conv(spconv.SparseConvTensor(conv_rows, indices, shape, 1)),
    }
    return found | ({'spconv_forward_backward_s': forward_backward} if backward else {})


def _norm(width: int) -> spconv.SparseSequential:
    return spconv.SparseSequential(nn.BatchNorm1d(width, eps=1e-4), nn.ReLU())


class _Block(spconv.SparseModule):
    def __init__(self, wide: int, width: int, key: str) -> None:
        super().__init__()
        self.branch = spconv.SparseSequential(
            _norm(wide),
            spconv.SubMConv3d(wide, width, 3, bias=False, indice_key=key),
            _norm(width),
            spconv.SubMConv3d(width, width, 3, bias=False, indice_key=key),
        )
        self.shortcut = nn.Identity() if wide == width else nn.Linear(wide, width, bias=False)

    def forward(self, inputs: spconv.SparseConvTensor) -> spconv.SparseConvTensor:
        hidden = self.branch(inputs)
        return hidden.replace_feature(hidden.features + self.shortcut(inputs.features))


class _Level(spconv.SparseModule):
    def __init__(self, channels: Sequence[int], blocks: int, depth: int) -> None:
        super().__init__()
        width, key = channels[0], f'level{depth}'
        self.encode = spconv.SparseSequential(*[_Block(width, width, key) for _ in range(blocks)])
        self.inner = None
        if len(channels) > 1:
            down = f'down{depth}'
            self.inner = spconv.SparseSequential(
                _norm(width),
                spconv.SparseConv3d(width, channels[1], 2, 2, bias=False, indice_key=down),
                _Level(channels[1:], blocks, depth + 1),
                _norm(channels[1]),
                spconv.SparseInverseConv3d(channels[1], width, 2, bias=False, indice_key=down),
            )
            wide = [2 * width] + [width] * (blocks - 1)
            self.decode = spconv.SparseSequential(*[_Block(w, width, key) for w in wide])

    def forward(self, inputs: spconv.SparseConvTensor) -> spconv.SparseConvTensor:
        skip = self.encode(inputs)
        if self.inner is None:
            return skip
        hidden = self.inner(skip)
        return self.decode(hidden.replace_feature(torch.cat([skip.features, hidden.features], dim=1)))


class _Net(nn.Module):
    def __init__(self, in_channels: int, channels: Sequence[int], blocks: int) -> None:
        super().__init__()
        self.layers = spconv.SparseSequential(
            spconv.SubMConv3d(in_channels, channels[0], 3, bias=False, indice_key='level0'),
            _Level(channels, blocks, 0),
            _norm(channels[0]),
        )

    def forward(self, inputs: spconv.SparseConvTensor) -> Tensor:
        return self.layers(inputs).features
