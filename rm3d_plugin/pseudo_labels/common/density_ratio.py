"""How much denser labelled rows lie than rows at large, at any place: no row without a label is taken for a negative.

Least squares importance fitting without constraints (uLSIF; Kanamori, Hido and Sugiyama, JMLR 2009): the ratio of two
densities as a sum of kernels, in closed form.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from rm3d_plugin.pseudo_labels.common.kernel_classifier import Scaling, evenly_spread, gaussian_kernel

LENGTH = 0.8  # of the kernel, in root mean square deviations of the columns
RIDGE = 0.1  # of the weights
_CHUNK = 1 << 14  # rows that are compared at once
CENTRES = 300  # of the kernels at most, at labelled rows and as many at others


class DensityRatio(NamedTuple):
    """Density of labelled rows over that of all rows.

    Attributes:
        scaling: Of all rows.
        centres: (M, F) of the kernels, scaled.
        weights: (M,) of the kernels.
    """

    scaling: Scaling
    centres: Float[np.ndarray, 'centres features']
    weights: Float[np.ndarray, ' centres']

    def of(self, rows: Float[np.ndarray, 'rows features']) -> Float[np.ndarray, ' rows']:
        """The ratio at rows (not scaled yet), never negative."""
        near = gaussian_kernel(self.scaling.apply(rows), self.centres, LENGTH)
        return np.asarray(np.maximum(near @ self.weights, 0.0), dtype=np.float64)


def fit_density_ratio(
    labelled: Float[np.ndarray, 'labelled features'], rows: Float[np.ndarray, 'rows features'], scaling: Scaling
) -> tuple[DensityRatio, Float[np.ndarray, ' labelled']]:
    """The ratio, and what it is at each labelled row where that row is left out of the mean; its kernel stays.

    Args:
        labelled: Rows of the denser kind, not scaled; at least one. One alone is not left out.
        rows: Rows at large, not scaled; at least one.
        scaling: See :func:`~rm3d_plugin.pseudo_labels.common.kernel_classifier.scaling_of`.

    Raises:
        ValueError: There is no labelled row, or no row at all.
    """
    if not len(labelled) or not len(rows):
        raise ValueError(
            f'fit_density_ratio: expected rows of both kinds, got {len(labelled)} labelled and {len(rows)} in all'
        )
    everything, own = scaling.apply(rows), scaling.apply(labelled)
    centres = np.concatenate([part[evenly_spread(len(part), CENTRES)] for part in (own, everything)])
    gram = RIDGE * np.eye(len(centres))
    for first in range(0, len(rows), _CHUNK):
        near = gaussian_kernel(everything[first : first + _CHUNK], centres, LENGTH).astype(np.float64)
        gram += near.T @ near / len(rows)
    at_own = gaussian_kernel(own, centres, LENGTH).astype(np.float64)
    solved = np.linalg.solve(gram, at_own.T)  # (M, labelled): weights that each labelled row asks for
    of_itself, count = np.einsum('ij,ji->i', at_own, solved), len(labelled)
    others = (at_own @ solved.sum(axis=1) - of_itself) / (count - 1) if count > 1 else of_itself
    ratio = DensityRatio(scaling, centres, solved.mean(axis=1))
    return ratio, np.maximum(others, 0.0)
