"""Scale-invariant heat kernel signature (METHOD 3; Bronstein and Kokkinos, CVPR 2010)."""

from typing import final

import numpy as np
from jaxtyping import Float

from rm3d_plugin.descriptors.spectral import SpectralDescriptor
from rm3d_plugin.ops.laplacian import Eigenpairs
from rm3d_plugin.registry import DESCRIPTORS

FREQUENCIES = 6
OCTAVES = (1.0, 25.0)  # tau
STEP = 1.0 / 16.0  # of tau
START = 0.01  # l_max t at the first tau: the heat kernel is still flat there, and is again at the last tau


def scale_invariant_heat_kernel_signature(
    pairs: Eigenpairs, frequencies: int = FREQUENCIES
) -> Float[np.ndarray, 'points frequencies']:
    """Magnitudes of the lowest Fourier coefficients of ``d/dtau log h(2^tau)``, without unit.

    ``h(t) = sum_k exp(-l_k t) phi_k^2`` over all pairs, the constant function among them, at tau = 1, 1 + 1/16,
    ..., 25. The unit of t is 1 / (200 l_max): l_max t runs from 0.01 to 168000, so that log h is flat at both ends. A
    larger surface shifts log h in tau and adds a constant; the derivative removes the constant, the magnitude the
    shift. The derivative is taken in closed form: ``-ln 2 t sum l_k exp(-l_k t) phi_k^2 / h``.

    Args:
        pairs: (K,) eigenvalues in 1 / m^2, the first about 0, and (N, K) functions.
        frequencies: Coefficients kept, from the constant one on.
    """
    steps = round((OCTAVES[1] - OCTAVES[0]) / STEP) + 1
    times = START / pairs.values[-1] * 2.0 ** (np.linspace(*OCTAVES, steps) - OCTAVES[0])
    eigenvalues = pairs.values.copy()
    eigenvalues[0] = 0.0  # what rounding leaves there would grow with t
    decay = np.exp(-np.outer(eigenvalues, times))
    squares = pairs.functions**2
    slope = -np.log(2.0) * (squares @ (eigenvalues[:, None] * times * decay)) / (squares @ decay)
    return np.abs(np.fft.rfft(slope, axis=1)[:, :frequencies])


@final
@DESCRIPTORS.register_module()
class SIHKS(SpectralDescriptor):
    """Scale-invariant heat kernel signature of every point, (N, 6) without unit; arguments: ``SpectralDescriptor``.

    Costs 0.01 ms a point of the sub-cloud beyond the eigenpairs. The sub-cloud has a spacing in metres: sizes compare
    as long as it resolves both.
    """

    @property
    def features(self) -> int:
        """Frequencies."""
        return FREQUENCIES

    def signature(self, pairs: Eigenpairs) -> Float[np.ndarray, 'samples features']:
        """:func:`scale_invariant_heat_kernel_signature`."""
        return scale_invariant_heat_kernel_signature(pairs)
