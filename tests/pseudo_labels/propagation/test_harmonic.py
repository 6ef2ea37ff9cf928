import numpy as np
import pytest
import scipy.sparse

from rm3d_plugin.pseudo_labels.propagation.harmonic import HarmonicSystem


def random_graph(rng, count, edges=4):
    start = np.repeat(np.arange(count), edges)
    end = rng.integers(0, count, len(start))
    kept = start != end
    upper = scipy.sparse.coo_array((rng.uniform(0.1, 1.0, kept.sum()), (start[kept], end[kept])), shape=(count, count))
    return (upper + upper.T).tocsr()


def dense(weights, labelled, strength, given, prior):
    """The same system, written out and solved as a whole."""
    matrix = weights.toarray()
    laplacian = np.diag(matrix.sum(axis=1) + strength) - matrix
    free = np.setdiff1d(np.arange(len(matrix)), labelled)
    out = np.zeros(prior.shape)
    out[labelled] = given
    pulled = strength[free, None] * prior[free] - laplacian[np.ix_(free, labelled)] @ given
    out[free] = np.linalg.solve(laplacian[np.ix_(free, free)], pulled)
    return out


@pytest.mark.parametrize('pull', [0.0, 0.3])
def test_shares_are_those_of_the_dense_system(pull):
    rng = np.random.default_rng(0)
    weights, labelled = random_graph(rng, 60), np.array([3, 17, 40, 41])
    given, strength = np.eye(3)[[0, 1, 2, 1]], pull * rng.uniform(0.5, 1.0, 60)
    prior = rng.dirichlet(np.ones(3), 60)
    shares = HarmonicSystem(weights, labelled, strength).shares(given, prior)
    np.testing.assert_allclose(shares, dense(weights, labelled, strength, given, prior), atol=1e-8)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=1e-8)
    np.testing.assert_array_equal(shares[labelled], given)


def test_a_part_without_a_label_has_its_prior_or_nothing():
    weights = scipy.sparse.csr_array(np.kron(np.eye(2), 1.0 - np.eye(3)))
    given, prior = np.eye(2)[[0]], np.full((6, 2), 0.5)
    alone = HarmonicSystem(weights, np.array([0]), np.zeros(6)).shares(given, prior)
    np.testing.assert_allclose(alone[:3], [[1.0, 0.0]] * 3, atol=1e-8)
    np.testing.assert_allclose(alone[3:], 0.0, atol=1e-8)
    pulled = HarmonicSystem(weights, np.array([0]), np.full(6, 0.1)).shares(given, prior)
    np.testing.assert_allclose(pulled[3:], 0.5, atol=1e-8)


def test_all_nodes_may_be_labelled():
    weights = scipy.sparse.csr_array(1.0 - np.eye(3))
    given = np.eye(3)
    np.testing.assert_array_equal(HarmonicSystem(weights, np.arange(3), np.zeros(3)).shares(given, given), given)
