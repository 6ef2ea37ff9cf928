"""Heat kernel signature (METHOD 3; Sun, Ovsjanikov, Guibas, SGP 2009)."""

from typing import final

import numpy as np
from jaxtyping import Float

from rm3d_plugin.descriptors.spectral import SpectralDescriptor
from rm3d_plugin.ops.laplacian import Eigenpairs
from rm3d_plugin.registry import DESCRIPTORS

TIMES = 100


def heat_times(eigenvalues: Float[np.ndarray, ' pairs'], count: int = TIMES) -> Float[np.ndarray, ' times']:
    """Log-spaced times from 4 ln 10 / l_max to 4 ln 10 / l_2, in square metres."""
    span = 4.0 * np.log(10.0)
    return np.geomspace(span / eigenvalues[-1], span / eigenvalues[1], count)


def heat_kernel_signature(pairs: Eigenpairs, count: int = TIMES) -> Float[np.ndarray, 'points times']:
    """``sum_{k>=2} exp(-l_k t) phi_k^2 / sum_{k>=2} exp(-l_k t)`` at each time, in 1 / m^2.

    Small times tell a point's close surroundings, large ones where it lies on the whole surface. Rows integrate to 1
    over the surface at each time.

    Args:
        pairs: (K,) eigenvalues, at least two of them, the second above 0, and (N, K) functions.
        count: Times.
    """
    decay = np.exp(-np.outer(pairs.values[1:], heat_times(pairs.values, count)))
    return np.asarray((pairs.functions[:, 1:] ** 2) @ (decay / decay.sum(axis=0)))


@final
@DESCRIPTORS.register_module()
class HKS(SpectralDescriptor):
    """Heat kernel signature of every point, (N, 100) in 1 / m^2; arguments and cost: ``SpectralDescriptor``."""

    @property
    def features(self) -> int:
        """Times."""
        return TIMES

    def signature(self, pairs: Eigenpairs) -> Float[np.ndarray, 'samples features']:
        """:func:`heat_kernel_signature`."""
        return heat_kernel_signature(pairs)
