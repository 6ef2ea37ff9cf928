"""Sparse U-Net (METHOD 7): per-point features from voxels, by submanifold convolutions."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from typing import Literal, cast

import torch
from jaxtyping import Float, Int64
from mmengine.model import BaseModule
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from rm3d_plugin.models.backbones.layers import InverseConv, NormReLU, ResidualBlock, SparseConv, SparseFeatures
from rm3d_plugin.models.init_config import InitConfig
from rm3d_plugin.ops._backends import Backend, check_backend
from rm3d_plugin.ops.level_cache import LevelCache
from rm3d_plugin.ops.voxelize import gather_rows, voxelize
from rm3d_plugin.registry import MODELS

Bottleneck = Callable[[SparseFeatures], SparseFeatures]
"""What is done to the features of the coarsest level, on their voxels."""

PRESETS: dict[str, tuple[int, ...]] = {
    'small': (16, 32, 48, 64),
    'paper': tuple(16 * level for level in range(1, 8)),  # METHOD 7: m = 16, levels m..7m
    'large': tuple(32 * level for level in range(1, 8)),
}


@MODELS.register_module()
class SparseUNet(BaseModule):
    """U-Net over the voxels of a batch.

    ::

        points -> voxels -> stem -> blocks ---------------- concat -> blocks -> BN ReLU -> voxels -> points
                                      | down k2 s2            | up, inverse of the down
                                      +-> blocks -- ... ------+

    Args:
        in_channels: Columns of the point features.
        voxel_size: Edge of a voxel in metres; larger: fewer voxels, faster, coarser.
        widths: Channels per level, finest first; its length is the number of levels.
        blocks: Residual blocks per level on each side; the coarsest level has one side.
        bn_eps: Added to the variance in batch normalisation.
        bn_momentum: Weight of a new batch in the running statistics.
        reduce: How the points of a voxel become one row.
        preset: ``'small'``, ``'paper'`` (m = 16, seven levels) or ``'large'`` (m = 32): replaces ``widths``.
        checkpointing: Recompute the blocks in backward: less memory, about a third more time.
        backend: Whose convolutions: ``'ours'``, or ``'spconv'`` where it is installed.
        map_cache: Megabytes of kernel maps that are kept for batches that come again; 0 keeps none.
        init_cfg: As in mmengine.

    Attributes:
        out_channels: Columns of the output, the width of the finest level.
        coarse_channels: Width of the coarsest level.
        reach: How far, along an axis, lie voxels that change what is said of one in evaluation, in voxels.
    """

    def __init__(
        self,
        in_channels: int,
        voxel_size: float,
        widths: Sequence[int] = PRESETS['small'],
        blocks: int = 2,
        bn_eps: float = 1e-4,
        bn_momentum: float = 0.1,
        reduce: Literal['mean', 'first'] = 'mean',
        preset: str | None = None,
        checkpointing: bool = False,
        backend: Backend = 'ours',
        map_cache: int = 256,
        init_cfg: InitConfig = None,
    ) -> None:
        super().__init__(init_cfg)
        check_backend(backend)
        if preset is not None and preset not in PRESETS:
            raise ValueError(f'preset must be one of {sorted(PRESETS)} or None, got {preset!r}')
        widths = tuple(widths) if preset is None else PRESETS[preset]
        if not widths or min(widths) < 1 or blocks < 1 or in_channels < 1:
            raise ValueError(
                f'in_channels, widths and blocks must be positive, got {in_channels}, {widths} and {blocks}'
            )
        if not voxel_size > 0:
            raise ValueError(f'voxel_size must be a positive length in metres, got {voxel_size}')
        self.voxel_size = voxel_size
        self.reduce: Literal['mean', 'first'] = reduce
        self.out_channels = widths[0]
        self.coarse_channels = widths[-1]
        self.reach = _reach(len(widths), blocks)
        self.stem = SparseConv(in_channels, widths[0])
        self.body = _Stage(widths, blocks, bn_eps, bn_momentum, checkpointing)
        self.norm = NormReLU(widths[0], bn_eps, bn_momentum)
        self.levels = LevelCache(map_cache)
        for module in self.modules():
            if isinstance(module, SparseConv | InverseConv):
                module.backend = backend

    def forward(
        self,
        xyz: Float[Tensor, 'points 3'],
        features: Float[Tensor, 'points in_channels'],
        batch_offsets: Int64[Tensor, 'scenes_plus_1'],
        bottleneck: Bottleneck | None = None,
    ) -> Float[Tensor, 'points out_channels']:
        """Features of every point, equal for the points of one voxel.

        Args:
            xyz: Metres, each scene in its local frame.
            features: Columns such as colour and coordinates.
            batch_offsets: Scene ``b`` owns rows ``batch_offsets[b]`` to ``batch_offsets[b + 1]``; some may be empty.
            bottleneck: Applied between the coarsest level and the way back.

        Raises:
            ValueError: If the batch holds no point at all, or a coordinate leaves the range of ``voxelize``.
        """
        if len(xyz) == 0:
            raise ValueError('SparseUNet got a batch without any point; leave such batches out in the data loader')
        voxels = voxelize(xyz, features, batch_offsets, self.voxel_size, self.reduce)
        hidden = self.stem(SparseFeatures(voxels.features, self.levels(voxels.coords)))
        hidden = self.body(hidden, bottleneck)
        return gather_rows(self.norm(hidden.values), voxels.point_to_voxel)


def _reach(levels: int, blocks: int) -> int:
    """Voxels: the stem sees 1, a block of level l twice 2^l, and a step down or up another 2^l."""
    coarsest = levels - 1
    both_sides = sum(2**level * (4 * blocks + 1) for level in range(coarsest))
    return 1 + both_sides + 2**coarsest * 2 * blocks


class _Stage(nn.Module):
    """One level of the U and, inside it, all coarser ones."""

    def __init__(
        self, widths: Sequence[int], blocks: int, bn_eps: float, bn_momentum: float, checkpointing: bool
    ) -> None:
        super().__init__()
        width = widths[0]
        self.checkpointing = checkpointing
        self.encode = nn.ModuleList([ResidualBlock(width, width, bn_eps, bn_momentum) for _ in range(blocks)])
        self.inner: _Stage | None = None
        if len(widths) > 1:
            coarse = widths[1]
            self.down_norm = NormReLU(width, bn_eps, bn_momentum)
            self.down = SparseConv(width, coarse, kernel_size=2, stride=2)
            self.inner = _Stage(widths[1:], blocks, bn_eps, bn_momentum, checkpointing)
            self.up_norm = NormReLU(coarse, bn_eps, bn_momentum)
            self.up = InverseConv(coarse, width)
            self.decode = nn.ModuleList(
                [ResidualBlock(width * (2 if i == 0 else 1), width, bn_eps, bn_momentum) for i in range(blocks)]
            )

    def forward(self, inputs: SparseFeatures, bottleneck: Bottleneck | None = None) -> SparseFeatures:
        skip = self._run(self.encode, inputs)
        if self.inner is None:
            return skip if bottleneck is None else bottleneck(skip)
        hidden = self.down(skip._replace(values=self.down_norm(skip.values)))
        hidden = self.inner(hidden, bottleneck)
        hidden = self.up(hidden._replace(values=self.up_norm(hidden.values)), skip.level)
        joined = skip._replace(values=torch.cat([skip.values, hidden.values], dim=1))
        return self._run(self.decode, joined)

    def _run(self, blocks: nn.ModuleList, inputs: SparseFeatures) -> SparseFeatures:
        for block in blocks:
            if self.checkpointing and self.training:
                contexts = partial(_recompute_contexts, block)
                inputs = cast(SparseFeatures, checkpoint(block, inputs, use_reentrant=False, context_fn=contexts))
            else:
                inputs = block(inputs)
        return inputs


def _recompute_contexts(block: nn.Module) -> tuple[AbstractContextManager[None], AbstractContextManager[None]]:
    return nullcontext(), _kept_buffers(block)


@contextmanager
def _kept_buffers(block: nn.Module) -> Iterator[None]:
    """Undo what a recomputed forward does to running statistics: a batch counts once."""
    before = [(buffer, buffer.clone()) for buffer in block.buffers()]
    try:
        yield
    finally:
        for buffer, value in before:
            buffer.copy_(value)
