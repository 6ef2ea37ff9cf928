import numpy as np
import scipy.sparse

from rm3d_plugin.pseudo_labels.propagation.coarsening import coarsen
from rm3d_plugin.pseudo_labels.propagation.point_graph import PointGraph


def chain(heavy, count=12):
    """A path whose even edges are heavy."""
    data = np.where(np.arange(count - 1) % 2 == 0, heavy, 1.0)
    weights = scipy.sparse.diags_array([data, data], offsets=[-1, 1]).tocsr()
    return PointGraph(weights, np.asarray(weights.sum(axis=1)).ravel())


def test_heavy_edges_are_joined_first_and_weights_between_nodes_add_up():
    coarse = coarsen(chain(5.0), np.zeros(0, np.int64), 6)
    np.testing.assert_array_equal(coarse.node, np.repeat(np.arange(6), 2))
    np.testing.assert_array_equal(coarse.weights.toarray(), np.eye(6, k=1) + np.eye(6, k=-1))
    np.testing.assert_array_equal(coarse.sizes, 2)


def test_labelled_points_stay_alone():
    coarse = coarsen(chain(5.0), np.array([0, 7]), 4)
    assert coarse.sizes[coarse.node[[0, 7]]].tolist() == [1, 1]
    assert coarse.sizes.sum() == 12


def test_labelled_points_do_not_make_the_others_coarser():
    stroke = np.arange(20)
    coarse = coarsen(chain(5.0, 60), stroke, 20)
    assert (coarse.sizes[coarse.node[stroke]] == 1).all()
    assert len(coarse.sizes) == 20 + 20 and coarse.sizes[coarse.node[20:]].max() == 2


def test_no_edges_no_nodes_joined():
    empty = PointGraph(scipy.sparse.csr_array((5, 5)), np.zeros(5))
    np.testing.assert_array_equal(coarsen(empty, np.zeros(0, np.int64), 2).node, np.arange(5))
