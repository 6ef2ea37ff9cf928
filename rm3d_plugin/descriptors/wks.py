"""Wave kernel signature (METHOD 3; Aubry, Schlickewei, Cremers, ICCV workshops 2011)."""

from typing import final

import numpy as np
from jaxtyping import Float

from rm3d_plugin.descriptors.spectral import SpectralDescriptor
from rm3d_plugin.ops.laplacian import Eigenpairs
from rm3d_plugin.registry import DESCRIPTORS

ENERGIES = 100
WIDTH = 6.0  # steps between energies; standard deviation of a Gaussian
TOP = 1.02  # the last energy is the largest log eigenvalue over it


def wave_kernel_signature(pairs: Eigenpairs, count: int = ENERGIES) -> Float[np.ndarray, 'points energies']:
    """``sum_{k>=2} g_k(e) phi_k^2 / sum_{k>=2} g_k(e)``, ``g_k(e) = exp(-(e - ln l_k)^2 / 2 sigma^2)``, in 1 / m^2.

    Energies e run evenly from ln l_2 to ln(l_max) / 1.02, sigma is six steps. Each energy passes a band of frequencies,
    so that fine detail is not drowned by coarse shape as in the heat kernel.

    Args:
        pairs: (K,) eigenvalues in 1 / m^2, at least two of them, the second above 0, and (N, K) functions.
        count: Energies.
    """
    logs = np.log(pairs.values[1:])
    last = logs[-1] / TOP if logs[-1] / TOP > logs[0] else logs[-1]
    energies = np.linspace(logs[0], last, count)
    sigma = WIDTH * max((last - logs[0]) / (count - 1), np.finfo(np.float64).eps)
    exponents = -((energies[None] - logs[:, None]) ** 2) / (2.0 * sigma**2)
    bands = np.exp(exponents - exponents.max(axis=0))  # the largest is 1: a gap in the spectrum leaves no 0 / 0
    return np.asarray((pairs.functions[:, 1:] ** 2) @ (bands / bands.sum(axis=0)))


@final
@DESCRIPTORS.register_module()
class WKS(SpectralDescriptor):
    """Wave kernel signature of every point, (N, 100) in 1 / m^2; arguments and cost: ``SpectralDescriptor``."""

    @property
    def features(self) -> int:
        """Energies."""
        return ENERGIES

    def signature(self, pairs: Eigenpairs) -> Float[np.ndarray, 'samples features']:
        """:func:`wave_kernel_signature`."""
        return wave_kernel_signature(pairs)
