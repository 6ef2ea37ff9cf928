"""Mixed precision without a GPU."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from mmengine.optim import OptimWrapper
from mmengine.registry import OPTIM_WRAPPERS
from torch import nn


@OPTIM_WRAPPERS.register_module()
class CPUAutocastOptimWrapper(OptimWrapper):
    """bfloat16 for the dense layers on a CPU (mmengine's AmpOptimWrapper wants a GPU); gradients need no scaling.

    Sparse convolutions keep single precision there: their kernels are faster than anything in half precision.
    """

    @contextmanager
    def optim_context(self, model: nn.Module) -> Iterator[None]:
        """What a forward pass runs under."""
        with super().optim_context(model), torch.autocast('cpu', torch.bfloat16):
            yield
