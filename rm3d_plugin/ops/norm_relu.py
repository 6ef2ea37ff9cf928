"""Batch normalisation followed by ReLU over the rows of a matrix, in two passes and without storing the middle."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
import torch.distributed as dist
from jaxtyping import Float
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

from rm3d_plugin.ops._parallel import Array, each_block, take_turn

PART = 1 << 16  # elements per partial sum, about; partial sums are added in order, so threads change nothing
STRIP = 512  # elements of an inner loop


class NormReLUResult(NamedTuple):
    """Output of :func:`norm_relu` with the statistics of the batch.

    Attributes:
        values: Rows of the input's shape, none negative.
        mean: Mean per channel.
        variance: Biased variance per channel.
        rows: Number of rows they are of: those of all processes, where several train together.
    """

    values: Float[Tensor, 'rows channels']
    mean: Float[Tensor, 'channels']
    variance: Float[Tensor, 'channels']
    rows: int


def norm_relu(
    x: Float[Tensor, 'rows channels'], scale: Float[Tensor, 'channels'], shift: Float[Tensor, 'channels'], eps: float
) -> NormReLUResult:
    """``relu((x - mean) / sqrt(variance + eps) * scale + shift)`` with the statistics of these rows, on the CPU.

    Sums run in float64 over blocks of fixed size: the same bits whatever the number of threads. Where several processes
    train together, the statistics are of the rows of all of them, and all must call this equally often.

    Args:
        x: float32 or float64, at least one row.
        scale: Factor per channel, learned.
        shift: Term per channel, learned.
        eps: Added to the variance.
    """
    count = rows_of_all_processes(len(x))
    values, mean, variance = _NormReLU.apply(x, scale, shift, eps, count)  # type: ignore[no-untyped-call]
    return NormReLUResult(values, mean, variance, count)


def rows_of_all_processes(rows: int) -> int:
    """Rows of a batch whose parts lie in several processes."""
    return int(_of_all_processes(np.array([float(rows)]))[0])


def _of_all_processes(sums: Array) -> Array:
    """Sums over the processes that train together."""
    if dist.is_available() and dist.is_initialized() and dist.get_world_size() > 1:
        dist.all_reduce(torch.from_numpy(sums))
    return sums


class _NormReLU(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, scale: Tensor, shift: Tensor, eps: float, count: int) -> tuple[Tensor, ...]:
        x = x.contiguous()
        rows, gain = x.numpy(), scale.numpy().astype(np.float64)
        sums = _of_all_processes(_channel_sums(_moments_in_turns, rows))
        mean = sums[0] / count
        variance = np.maximum(sums[1] / count - mean**2, 0)
        inverse_std = 1 / np.sqrt(variance + eps)
        factor = _strip(inverse_std * gain, rows.dtype)
        term = _strip(shift.numpy() - mean * inverse_std * gain, rows.dtype)
        out = torch.empty_like(x)
        _each_part(_scale_relu_in_turns, rows, out.numpy().reshape(-1), rows.reshape(-1), factor, term)
        ctx.save_for_backward(x, scale)
        ctx.statistics = (mean, inverse_std, factor, term)
        ctx.count = count
        statistics = torch.from_numpy(mean).to(x.dtype), torch.from_numpy(variance).to(x.dtype)
        ctx.mark_non_differentiable(*statistics)
        return out, *statistics

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor, *_: Any) -> tuple[Tensor | None, ...]:
        x, scale = ctx.saved_tensors
        mean, inverse_std, factor, term = ctx.statistics
        rows, slopes = x.numpy(), grad.contiguous().numpy().reshape(-1)
        sums = _channel_sums(_grad_moments_in_turns, rows, slopes, factor, term)
        grad_shift = sums[0]
        grad_scale = (sums[1] - mean * sums[0]) * inverse_std
        gain = inverse_std * scale.numpy()
        shared = _of_all_processes(np.stack([grad_scale, grad_shift])) / ctx.count
        along = -gain * inverse_std * shared[0]
        level = _strip(-gain * shared[1] - along * mean, rows.dtype)
        constants = factor, term, _strip(along, rows.dtype), level
        out = torch.empty_like(x)
        _each_part(_input_grad_in_turns, rows, out.numpy().reshape(-1), rows.reshape(-1), slopes, *constants)
        return (
            out,
            torch.from_numpy(grad_scale).to(scale.dtype),
            torch.from_numpy(grad_shift).to(scale.dtype),
            None,
            None,
        )


def _strip(channels: Array, dtype: Any) -> Array:
    """The values of a few rows side by side, so that the inner loops are long also where channels are few."""
    return np.tile(channels, max(1, STRIP // len(channels))).astype(dtype)


def _step(rows: Array) -> int:
    """Elements of a block: whole rows."""
    return max(1, PART // rows.shape[1]) * rows.shape[1]


def _each_part(kernel: Callable[..., None], rows: Array, *arguments: Array) -> None:
    """Run a kernel over all blocks of the rows."""
    step = _step(rows)
    each_block(lambda turns: kernel(turns, step, *arguments), -(-rows.size // step), least=8)


def _channel_sums(kernel: Callable[..., None], rows: Array, *arguments: Array) -> Array:
    channels = rows.shape[1]
    strip = len(_strip(np.zeros(channels), rows.dtype))
    sums = np.zeros((-(-rows.size // _step(rows)), 2, strip))
    _each_part(kernel, rows, sums, rows.reshape(-1), *arguments)
    return sums.sum(axis=0).reshape(2, -1, channels).sum(axis=1)


@njit(cache=True, nogil=True)
def _moments_in_turns(turns: Array, step: int, sums: Array, x: Array) -> None:
    turn = take_turn(turns)
    while turn < len(sums):
        _moments(sums[turn], x, turn * step, min((turn + 1) * step, len(x)))
        turn = take_turn(turns)


@njit(cache=True, nogil=True)
def _grad_moments_in_turns(
    turns: Array, step: int, sums: Array, x: Array, grad: Array, factor: Array, term: Array
) -> None:
    turn = take_turn(turns)
    while turn < len(sums):
        _grad_moments(sums[turn], x, grad, factor, term, turn * step, min((turn + 1) * step, len(x)))
        turn = take_turn(turns)


@njit(cache=True, nogil=True)
def _scale_relu_in_turns(turns: Array, step: int, out: Array, x: Array, factor: Array, term: Array) -> None:
    turn = take_turn(turns)
    while turn * step < len(x):
        _scale_relu(out, x, factor, term, turn * step, min((turn + 1) * step, len(x)))
        turn = take_turn(turns)


@njit(cache=True, nogil=True)
def _input_grad_in_turns(
    turns: Array, step: int, out: Array, x: Array, grad: Array, factor: Array, term: Array, along: Array, level: Array
) -> None:
    turn = take_turn(turns)
    while turn * step < len(x):
        _input_grad(out, x, grad, factor, term, along, level, turn * step, min((turn + 1) * step, len(x)))
        turn = take_turn(turns)


@njit(cache=True, nogil=True)
def _moments(sums: Array, x: Array, begin: int, end: int) -> None:
    first, second = sums[0], sums[1]
    for start in range(begin, end, len(first)):
        strip = x[start : min(start + len(first), end)]  # a slice: numba vectorises only indices known to be positive
        for c in range(len(strip)):
            value = np.float64(strip[c])
            first[c] += value
            second[c] += value * value


@njit(cache=True, nogil=True)
def _scale_relu(out: Array, x: Array, factor: Array, term: Array, begin: int, end: int) -> None:
    for start in range(begin, end, len(factor)):
        stop = min(start + len(factor), end)
        strip, result = x[start:stop], out[start:stop]
        for c in range(len(strip)):
            value = strip[c] * factor[c] + term[c]
            result[c] = x.dtype.type(0) if value < 0 else value  # NaN stays NaN


@njit(cache=True, nogil=True)
def _grad_moments(sums: Array, x: Array, grad: Array, factor: Array, term: Array, begin: int, end: int) -> None:
    first, second = sums[0], sums[1]
    for start in range(begin, end, len(factor)):
        stop = min(start + len(factor), end)
        strip, slopes = x[start:stop], grad[start:stop]
        for c in range(len(strip)):
            kept = np.float64(slopes[c] if strip[c] * factor[c] + term[c] > 0 else x.dtype.type(0))
            first[c] += kept
            second[c] += kept * np.float64(strip[c])


@njit(cache=True, nogil=True)
def _input_grad(
    out: Array, x: Array, grad: Array, factor: Array, term: Array, along: Array, level: Array, begin: int, end: int
) -> None:
    for start in range(begin, end, len(factor)):
        stop = min(start + len(factor), end)
        strip, slopes, result = x[start:stop], grad[start:stop], out[start:stop]
        for c in range(len(strip)):
            kept = slopes[c] if strip[c] * factor[c] + term[c] > 0 else x.dtype.type(0)
            result[c] = factor[c] * kept + along[c] * strip[c] + level[c]
