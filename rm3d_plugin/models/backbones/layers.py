"""Layers over sparse voxels: thin modules around the functions of ``ops.sparse_conv``."""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from rm3d_plugin.ops._backends import Backend
from rm3d_plugin.ops.kernel_map import KernelSpec, VoxelLevel, triple
from rm3d_plugin.ops.norm_relu import NormReLUResult, norm_relu, rows_of_all_processes
from rm3d_plugin.ops.sparse_conv import sparse_conv


class SparseFeatures(NamedTuple):
    """Features on the voxels of a level.

    Attributes:
        values: One row per voxel of ``level``.
        level: The voxels and their shared kernel maps.
    """

    values: Float[Tensor, 'voxels channels']
    level: VoxelLevel


class SparseConv(nn.Module):
    """Convolution from a level to the level ``stride`` times coarser; submanifold (same voxels) at stride 1.

    Args:
        in_channels: Columns of the input.
        out_channels: Columns of the output.
        kernel_size: Voxels per axis, one number or three.
        stride: Step in voxels; the output voxels are the cells ``floor(coordinate / stride)`` that hold an input.
        dilation: Distance between kernel elements in voxels.
        bias: Whether a bias is learned.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel_size: int | tuple[int, int, int] = 3,
        stride: int | tuple[int, int, int] = 1,
        dilation: int | tuple[int, int, int] = 1,
        bias: bool = False,
    ) -> None:
        super().__init__()
        self.backend: Backend = 'ours'
        self.spec = KernelSpec(
            triple(kernel_size, 'kernel_size'), triple(stride, 'stride'), triple(dilation, 'dilation')
        )
        self.weight = _kaiming_weight(len(self.spec.offsets()), in_channels, out_channels)
        self.bias = nn.Parameter(torch.zeros(out_channels)) if bias else None

    def forward(self, inputs: SparseFeatures) -> SparseFeatures:
        """Features on ``inputs.level.coarser(stride)``."""
        kernel_map = inputs.level.kernel_map(self.spec)
        values = sparse_conv(inputs.values, self.weight, kernel_map, self.bias, self.backend)
        return SparseFeatures(values, inputs.level.coarser(self.spec.stride))


class InverseConv(nn.Module):
    """Transposed convolution back to the finer level that a ``SparseConv`` of the same kernel and stride came from.

    Args:
        in_channels: Columns of the coarse input.
        out_channels: Columns of the fine output.
        kernel_size: Voxels per axis.
        stride: Step in fine voxels.
        bias: Whether a bias is learned.
    """

    def __init__(
        self, in_channels: int, out_channels: int, kernel_size: int = 2, stride: int = 2, bias: bool = False
    ) -> None:
        super().__init__()
        self.backend: Backend = 'ours'
        self.spec = KernelSpec(triple(kernel_size, 'kernel_size'), triple(stride, 'stride'))
        self.weight = _kaiming_weight(len(self.spec.offsets()), in_channels, out_channels)
        self.bias = nn.Parameter(torch.zeros(out_channels)) if bias else None

    def forward(self, inputs: SparseFeatures, finer: VoxelLevel) -> SparseFeatures:
        """Features on ``finer``, the level whose ``coarser(stride)`` is ``inputs.level``."""
        kernel_map = finer.kernel_map(self.spec).transposed()
        return SparseFeatures(sparse_conv(inputs.values, self.weight, kernel_map, self.bias, self.backend), finer)


class NormReLU(nn.Module):
    """Batch normalisation over all voxels of the batch, then ReLU.

    A batch of a single voxel has no variance: in training it is normalised with the running statistics, which stay
    as they are.
    """

    def __init__(self, channels: int, eps: float, momentum: float) -> None:
        super().__init__()
        self.norm = nn.BatchNorm1d(channels, eps=eps, momentum=momentum)

    def forward(self, values: Float[Tensor, 'voxels channels']) -> Float[Tensor, 'voxels channels']:
        """Rows of the same shape, none negative."""
        norm = self.norm
        if not self.training:
            return norm(values).relu()
        ours = type(norm) is nn.BatchNorm1d and values.device.type == 'cpu'
        ours = ours and values.dtype in (torch.float32, torch.float64)
        if (rows_of_all_processes(len(values)) if ours else len(values)) == 1:
            return nn.functional.batch_norm(
                values, norm.running_mean, norm.running_var, norm.weight, norm.bias, False, 0.0, norm.eps
            ).relu()
        if not ours:
            return norm(values).relu()  # such as a norm that was converted to synchronise over processes
        result = norm_relu(values, norm.weight, norm.bias, norm.eps)
        _update_running(norm, result)
        return result.values


def _update_running(norm: nn.BatchNorm1d, result: NormReLUResult) -> None:
    """Move the running statistics towards this batch, with the unbiased variance, as torch does."""
    assert norm.running_mean is not None and norm.running_var is not None and norm.num_batches_tracked is not None
    assert norm.momentum is not None
    norm.num_batches_tracked += 1
    with torch.no_grad():
        norm.running_mean.lerp_(result.mean, norm.momentum)
        norm.running_var.lerp_(result.variance * (result.rows / max(result.rows - 1, 1)), norm.momentum)


class ResidualBlock(nn.Module):
    """BN-ReLU-SubConv twice, added to the input (through a 1x1x1 convolution where the width changes)."""

    def __init__(self, in_channels: int, out_channels: int, bn_eps: float, bn_momentum: float) -> None:
        super().__init__()
        self.norm1 = NormReLU(in_channels, bn_eps, bn_momentum)
        self.conv1 = SparseConv(in_channels, out_channels)
        self.norm2 = NormReLU(out_channels, bn_eps, bn_momentum)
        self.conv2 = SparseConv(out_channels, out_channels)
        # A kernel of one voxel instead of nn.Linear: its sums do not depend on the number of threads.
        self.shortcut = nn.Identity() if in_channels == out_channels else SparseConv(in_channels, out_channels, 1)

    def forward(self, inputs: SparseFeatures) -> SparseFeatures:
        """Features on the same level."""
        hidden = self.conv1(inputs._replace(values=self.norm1(inputs.values)))
        hidden = self.conv2(hidden._replace(values=self.norm2(hidden.values)))
        return hidden._replace(values=hidden.values.add_(self.shortcut(inputs).values))  # backward needs no old values


def _kaiming_weight(offsets: int, in_channels: int, out_channels: int) -> nn.Parameter:
    """Normal weights of variance 2 / fan-in (He et al.), fan-in counting every kernel offset."""
    scale = (2.0 / (offsets * in_channels)) ** 0.5
    return nn.Parameter(torch.randn(offsets, in_channels, out_channels) * scale)
