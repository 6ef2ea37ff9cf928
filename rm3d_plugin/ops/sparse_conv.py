"""Sparse convolution and pooling over a kernel map: output row += input row @ weight of the offset, for every pair."""

from collections.abc import Iterator
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from rm3d_plugin.ops._backends import Backend, spconv_conv
from rm3d_plugin.ops._gather_gemm import gather_gemm, gather_outer
from rm3d_plugin.ops.kernel_map import KernelMap

_BLOCK_VALUES = 1 << 26  # gathered at once on a GPU, 256 MB in single precision


def sparse_conv(
    features: Float[Tensor, 'inputs in_channels'],
    weight: Float[Tensor, 'offsets in_channels out_channels'],
    kernel_map: KernelMap,
    bias: Float[Tensor, 'out_channels'] | None = None,
    backend: Backend = 'ours',
) -> Float[Tensor, 'outputs out_channels']:
    """Convolve sparse voxels: submanifold, strided or (with a transposed map) inverse, as the map says.

    Equal to a dense convolution whose empty voxels are zero, read at the output voxels only. Sums run over the
    offsets in order, so results do not change from run to run nor with the number of threads.

    Args:
        features: One row per input voxel; taken in the precision of the weight, also under autocast.
        weight: One matrix per kernel offset, in the order of ``KernelSpec.offsets``.
        kernel_map: From ``VoxelLevel.kernel_map``; ``.transposed()`` of it for the inverse convolution.
        bias: Added to every output row.
        backend: ``'ours'`` runs anywhere; ``'spconv'``, where it is installed.

    Raises:
        ValueError: If features or weight do not fit the map.
    """
    if features.shape[0] != kernel_map.n_in or weight.shape[:2] != (len(kernel_map.starts) - 1, features.shape[1]):
        raise ValueError(
            f'the map has {kernel_map.n_in} input voxels and {len(kernel_map.starts) - 1} offsets; '
            f'got features {tuple(features.shape)} and weight {tuple(weight.shape)} (offsets, in, out)'
        )
    with torch.autocast(features.device.type, enabled=False):
        if backend == 'spconv':
            out = spconv_conv(features.to(weight.dtype).contiguous(), weight, kernel_map)
        else:
            out = _SparseConv.apply(features.to(weight.dtype), weight, kernel_map)  # type: ignore[no-untyped-call]
    return out if bias is None else out + bias


def _forward(features: Tensor, weight: Tensor, kernel_map: KernelMap) -> Tensor:
    if _has_kernel(features):
        pairs = kernel_map.pair_in.numpy(), kernel_map.pair_out.numpy(), kernel_map.starts
        return torch.from_numpy(gather_gemm(features.numpy(), weight.numpy(), *pairs, kernel_map.n_out))
    return _forward_plain(features, weight, kernel_map)


def _weight_grad(features: Tensor, grad: Tensor, kernel_map: KernelMap) -> Tensor:
    if _has_kernel(features):
        pairs = kernel_map.pair_in.numpy(), kernel_map.pair_out.numpy(), kernel_map.starts
        return torch.from_numpy(gather_outer(features.numpy(), grad.numpy(), *pairs))
    return _weight_grad_plain(features, grad, kernel_map)


def _has_kernel(features: Tensor) -> bool:
    """Whether the numba kernels serve this tensor; other devices and half precision take the plain torch path."""
    return features.device.type == 'cpu' and features.dtype in (torch.float32, torch.float64)


def _forward_plain(features: Tensor, weight: Tensor, kernel_map: KernelMap) -> Tensor:
    out = features.new_empty((kernel_map.n_out, weight.shape[2]))
    flat = weight.reshape(-1, weight.shape[2])
    for rows, gathered in _gathered_blocks(features, kernel_map):
        torch.mm(gathered, flat, out=out[rows])
    return out


def _weight_grad_plain(features: Tensor, grad: Tensor, kernel_map: KernelMap) -> Tensor:
    out = features.new_zeros((kernel_map.table.shape[1] * features.shape[1], grad.shape[1]))
    for rows, gathered in _gathered_blocks(features, kernel_map):
        out.addmm_(gathered.T, grad[rows])
    return out.view(-1, features.shape[1], grad.shape[1])


def _gathered_blocks(features: Tensor, kernel_map: KernelMap) -> Iterator[tuple[slice, Tensor]]:
    """For some output rows at a time, the input rows under all offsets side by side; zeros where there is none.

    One product takes the place of one for each offset: on a GPU, the starts of many small ones cost more than zeros.
    """
    table, padded = kernel_map.table, torch.cat([features, features.new_zeros((1, features.shape[1]))])
    step = max(1, _BLOCK_VALUES // max(1, table.shape[1] * features.shape[1]))
    for first in range(0, len(table), step):
        rows = slice(first, first + step)
        yield rows, padded[table[rows]].flatten(1)


class _SparseConv(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, weight: Tensor, kernel_map: KernelMap) -> Tensor:
        ctx.save_for_backward(features, weight)
        ctx.kernel_map = kernel_map
        return _forward(features, weight, kernel_map)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        features, weight = ctx.saved_tensors
        grad_features = grad_weight = None
        if ctx.needs_input_grad[0]:
            grad_features = _forward(grad, weight.transpose(1, 2), ctx.kernel_map.transposed())
        if ctx.needs_input_grad[1]:
            grad_weight = _weight_grad(features, grad, ctx.kernel_map)
        return grad_features, grad_weight, None
