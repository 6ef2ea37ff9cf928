"""Which library multiplies: our own convolutions, or spconv where it is installed and asked for.

Both take the same weights and the same kernel maps, so a checkpoint does not know where it was trained. On a GPU ours
was faster (docs/RESULTS.md); spconv on a CPU gives wrong rows with several threads. It is for comparing.
"""

from functools import cache
from importlib.util import find_spec
from typing import Any, Literal, get_args

from jaxtyping import Float
from torch import Tensor

from rm3d_plugin.ops.kernel_map import KernelMap

Backend = Literal['ours', 'spconv']


def check_backend(name: str) -> None:
    """Refuse a backend that does not exist, or is not there.

    Raises:
        ValueError: An unknown name.
        ImportError: spconv is asked for and not installed.
    """
    if name not in get_args(Backend):
        raise ValueError(f'backend must be one of {get_args(Backend)}, got {name!r}')
    if name == 'spconv' and not has_spconv():
        raise ImportError("backend='spconv': spconv is not installed; pip install spconv-cuXXX, or use 'ours'")


@cache
def has_spconv() -> bool:
    """Whether spconv is installed."""
    return find_spec('spconv') is not None


def spconv_conv(
    features: Float[Tensor, 'inputs in_channels'],
    weight: Float[Tensor, 'offsets in_channels out_channels'],
    kernel_map: KernelMap,
) -> Float[Tensor, 'outputs out_channels']:
    """:func:`~rm3d_plugin.ops.sparse_conv.sparse_conv` without bias by spconv's gather, product and scatter.

    Args:
        features: Contiguous rows of the input voxels.
        weight: One matrix per kernel offset.
        kernel_map: Pairs of rows; submanifold, strided or transposed.
    """
    functional, algorithm = _spconv(features.is_cuda)
    pairs, counts = kernel_map.padded_pairs
    filters = weight.permute(2, 0, 1)[:, :, None, None, :].contiguous()  # (out, offsets, 1, 1, in)
    return functional.indice_conv(features, filters, pairs, counts, kernel_map.n_out, algorithm)


@cache
def _spconv(cuda: bool) -> tuple[Any, Any]:
    from spconv.core import ConvAlgo
    from spconv.pytorch import functional, ops

    if not cuda:
        ops.get_current_stream = lambda: 0  # asks CUDA even where all tensors are on the CPU; backward fails
    return functional, ConvAlgo.Native
