"""Laplacian of a point cloud and its lowest eigenpairs (METHOD 3; Sharp and Crane, SGP 2020)."""

from typing import NamedTuple

import numpy as np
import robust_laplacian
import scipy.linalg
import scipy.sparse
import scipy.sparse.csgraph
import scipy.sparse.linalg
from jaxtyping import Float, Int

from rm3d_plugin.ops._blas import one_blas_thread

SHIFT = -1e-2  # 1/m^2; just below the eigenvalue 0, so that the shifted matrix is positive definite
SPARE = 32  # vectors that the iteration keeps beyond the wanted ones: 96 for 64
DENSE_BELOW = 3  # times the wanted pairs: so few points are solved as a dense matrix
NO_TRIANGLES = 'unreferenced vertex'  # what the library says where a point's neighbours lie on a line
LEAST_MASS = 1e-6  # of the mean; a point's area is never less


class Laplacian(NamedTuple):
    """Weak Laplacian of a surface sampled by points: ``stiffness @ f = mass * (-laplace f)``.

    Attributes:
        stiffness: (N, N) sparse, symmetric, positive semi-definite; rows sum to 0; no unit.
        mass: (N,) area of each point in square metres, positive.
    """

    stiffness: scipy.sparse.csc_matrix
    mass: Float[np.ndarray, ' points']


class Eigenpairs(NamedTuple):
    """Lowest eigenpairs of ``stiffness @ phi = eigenvalue * mass * phi``.

    Attributes:
        values: (K,) ascending, 1 / m^2; the first is 0 on a connected surface.
        functions: (N, K) columns of unit norm in the mass, 1 / m.
    """

    values: Float[np.ndarray, ' pairs']
    functions: Float[np.ndarray, 'points pairs']


def point_laplacian(
    points: Float[np.ndarray, 'points 3'], n_neighbors: int = 30, mollify: float = 1e-5
) -> Laplacian | None:
    """The tufted Laplacian over local triangulations of the nearest points.

    Args:
        points: (N, 3) metres, no two in one place, more than ``n_neighbors``.
        n_neighbors: Nearest points that a local triangulation uses.
        mollify: Relative to the mean edge; how much degenerate triangles are widened.

    Returns:
        The operator, or None where a point's neighbours span no surface (all on a line, say).

    Raises:
        ValueError: There are not more than ``n_neighbors`` points.
    """
    if len(points) <= n_neighbors:
        raise ValueError(f'point_laplacian: expected more than n_neighbors = {n_neighbors} points, got {len(points)}')
    centred = np.ascontiguousarray(points, dtype=np.float64) - np.mean(points, axis=0, dtype=np.float64)
    try:
        stiffness, mass_matrix = robust_laplacian.point_cloud_laplacian(centred, mollify, n_neighbors)
    except RuntimeError as error:
        if NO_TRIANGLES not in str(error):
            raise
        return None
    mass = mass_matrix.diagonal()
    if not (np.isfinite(stiffness.data).all() and np.isfinite(mass).all() and mass.sum() > 0):
        return None
    symmetric = scipy.sparse.csc_matrix((stiffness + stiffness.T) * 0.5)
    return Laplacian(symmetric, np.maximum(mass, LEAST_MASS * mass.mean()))


def connected_parts(laplacian: Laplacian) -> list[tuple[Int[np.ndarray, ' rows'], Laplacian]]:
    """Divide an operator into parts that share no entry; each with its rows, ascending, in the order of the first."""
    count, labels = scipy.sparse.csgraph.connected_components(laplacian.stiffness, directed=False)
    if count == 1:
        return [(np.arange(len(labels)), laplacian)]
    rows = [np.flatnonzero(labels == part) for part in range(count)]
    by_row = scipy.sparse.csr_matrix(laplacian.stiffness)
    return [(r, Laplacian(scipy.sparse.csc_matrix(by_row[r][:, r]), laplacian.mass[r])) for r in rows]


def lowest_eigenpairs(laplacian: Laplacian, count: int) -> Eigenpairs:
    """The ``count`` lowest eigenpairs, by shift and invert on the symmetric matrix ``D^-1/2 L D^-1/2``.

    One sparse factorisation serves all iterations, which start from a fixed vector; the result is deterministic but for
    the sign of a function, or the basis where eigenvalues coincide.

    Args:
        laplacian: Over a connected surface.
        count: Eigenpairs, the constant function among them; all N where there are fewer.

    Returns:
        min(count, N) pairs; eigenvalues that rounding made negative are 0.
    """
    scale = 1.0 / np.sqrt(laplacian.mass)
    diagonal = scipy.sparse.diags_array(scale)
    matrix = scipy.sparse.csc_matrix(diagonal @ laplacian.stiffness @ diagonal)
    with one_blas_thread():
        values, vectors = _lowest(matrix, min(count, len(scale)))
    order = np.argsort(values, kind='stable')
    return Eigenpairs(np.maximum(values[order], 0.0), vectors[:, order] * scale[:, None])


def _lowest(matrix: scipy.sparse.csc_matrix, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The lowest eigenvalues and unit eigenvectors of a symmetric positive semi-definite matrix."""
    n = matrix.shape[0]
    if n <= DENSE_BELOW * count:
        values, vectors = scipy.linalg.eigh(matrix.toarray(), subset_by_index=[0, count - 1])
        return values, vectors
    shifted = scipy.sparse.csc_matrix(matrix - SHIFT * scipy.sparse.eye_array(n))
    factors = scipy.sparse.linalg.splu(
        shifted, permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0, options={'SymmetricMode': True}
    )
    inverse = scipy.sparse.linalg.LinearOperator((n, n), matvec=factors.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(n)
    values, vectors = scipy.sparse.linalg.eigsh(
        matrix, count, sigma=SHIFT, OPinv=inverse, v0=start, ncv=min(count + SPARE, n), which='LM'
    )
    return values, vectors
