"""The random walker (Grady 2006) with a prior at each node (Grady 2005), solved directly on a graph of thousands."""

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from jaxtyping import Float, Int

LEAST = 1e-12  # of the largest degree, so that parts without a labelled node have an answer: the prior, or nothing


class HarmonicSystem:
    """Classes at free nodes as the mean of what neighbours have, weighed by edges, and of what the prior says.

    Minimises sum_ij w_ij |x_i - x_j|^2 / 2 + sum_i g_i |x_i - u_i|^2 with x given at labelled nodes. Factored once;
    answers any number of labels and priors.

    Args:
        weights: (M, M) symmetric CSR, no diagonal.
        labelled: Nodes whose classes are given, each once.
        strength: (M,) g, in the unit of the weights; 0: the plain random walker.
    """

    def __init__(
        self,
        weights: scipy.sparse.csr_array,
        labelled: Int[np.ndarray, ' labelled'],
        strength: Float[np.ndarray, ' nodes'],
    ) -> None:
        degree = np.asarray(weights.sum(axis=1), dtype=np.float64).ravel()
        self._labelled, self._strength = labelled, strength
        self._free = np.setdiff1d(np.arange(weights.shape[0]), labelled)
        rows = weights[self._free]
        self._pull = rows[:, labelled]
        diagonal = degree + strength + LEAST * max(float(degree.max(initial=0.0)), 1e-12)
        matrix = scipy.sparse.diags_array(diagonal[self._free]) - rows[:, self._free]
        options = {'SymmetricMode': True}
        self._solve = (
            scipy.sparse.linalg.splu(
                matrix.tocsc(), permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0, options=options
            ).solve
            if len(self._free)
            else None
        )

    def shares(
        self, classes: Float[np.ndarray, 'labelled classes'], prior: Float[np.ndarray, 'nodes classes']
    ) -> Float[np.ndarray, 'nodes classes']:
        """Solve for all classes.

        Args:
            classes: Rows of sum 1 at the labelled nodes.
            prior: Rows of sum 1 everywhere.

        Returns:
            Rows of sum 1 but for nodes that nothing reaches, which have zeros.
        """
        out = np.zeros(prior.shape)
        out[self._labelled] = classes
        if self._solve is not None:
            pulled = self._pull @ classes + self._strength[self._free, None] * prior[self._free]
            out[self._free] = self._solve(pulled)
        return out
