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
    """The ratio, and what it is at each labelled row where that row is left out.

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
    near, at_own = (gaussian_kernel(part, centres, LENGTH).astype(np.float64) for part in (everything, own))
    gram = near.T @ near / len(rows) + RIDGE * np.eye(len(centres))
    solved = np.linalg.solve(gram, at_own.T)  # (M, labelled): weights that each labelled row asks for
    said = at_own @ solved
    count = len(labelled)
    others = (said.sum(axis=1) - np.diag(said)) / (count - 1) if count > 1 else np.diag(said)
    ratio = DensityRatio(scaling, centres, solved.mean(axis=1))
    return ratio, np.maximum(others, 0.0)
