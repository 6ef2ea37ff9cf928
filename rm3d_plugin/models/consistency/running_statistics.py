"""A second view that leaves the running statistics of batch normalisation alone."""

from collections.abc import Iterator
from contextlib import contextmanager

from torch import nn


@contextmanager
def kept_statistics(module: nn.Module) -> Iterator[None]:
    """Run a module so that its buffers end as they began.

    A thinned, distorted view has other statistics than the scans of the test. Mixed into the running averages, they
    would spoil what is learned from the first view alone: offsets, above all. Copies take the place of the buffers
    meanwhile, so what backward needs of the first view is not touched.
    """
    held = [(part, name, value) for part in module.modules() for name, value in part._buffers.items()]
    for part, name, value in held:
        part._buffers[name] = None if value is None else value.clone()
    try:
        yield
    finally:
        for part, name, value in held:
            part._buffers[name] = value
