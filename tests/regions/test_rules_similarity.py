"""Schedule, thresholds and the similarities, by hand."""

import numpy as np
import pytest

from rm3d_plugin.regions import MergeRules
from rm3d_plugin.regions import similarity as sim
from rm3d_plugin.structures import RegionGraph

PAIR = np.array([[0, 1]])


def test_the_weights_go_from_geometry_to_semantics():
    rules = MergeRules(rounds=8)
    assert rules.weights(0) == (1, 1, 1, 0)
    assert rules.weights(4) == (0.5, 0.5, 0.5, 0.5)
    assert rules.weights(8) == (0, 0, 0, 1)
    assert MergeRules(weight_balancing=False).weights(3) == (1, 1, 1, 1)
    off = MergeRules(weight_balancing=False, without=('color', 'semantics'))
    assert off.weights(3) == (0, 1, 1, 0)
    with pytest.raises(ValueError, match=r'0\.\.8, got 9'):
        rules.weights(9)


def test_normalised_and_literal_thresholds_agree_in_the_middle():
    normalised, literal = MergeRules(), MergeRules(thresholds='literal')
    assert (normalised.merge_threshold(), normalised.seed_threshold()) == (0.625, 0.75)
    assert (literal.merge_threshold(), literal.seed_threshold()) == (1.25, 1.5)
    total = sum(normalised.weights(4))
    assert literal.merge_threshold() / total == normalised.merge_threshold()


@pytest.mark.parametrize(
    'field, value',
    [
        ('tau_merge', -1),
        ('tau_seed', 1.0),
        ('thresholds', 'strict'),
        ('gamma', 0),
        ('gamma', float('nan')),
        ('lambda_seg', -1),
        ('pooling', 'median'),
        ('color_sigma', 0),
        ('intensity_sigma', float('inf')),
        ('rounds', 0),
        ('rounds', 2.5),
        ('demote_margin', 0.8),
        ('centre_distance', 0),
        ('centre_distance', (0.3, -1)),
        ('seed_share', 2),
        ('without', ('colour',)),
        ('without', 'color'),
        ('lambda_normal', -1),
        ('weight_balancing', 1),
    ],
)
def test_a_bad_value_is_named(field, value):
    with pytest.raises(ValueError, match=rf'MergeRules\.{field}: expected .* got'):
        MergeRules(**{field: value})


def test_centre_limits():
    classes = np.array([0, 1, -1])
    assert MergeRules().centre_limit(classes).tolist() == [np.inf] * 3
    assert MergeRules(centre_distance=0.3).centre_limit(classes).tolist() == [0.3] * 3
    assert MergeRules(centre_distance=[1.0, None]).centre_limit(classes).tolist() == [1.0, np.inf, np.inf]


def test_color():
    colors = np.array([[50.0, 0, 0], [50, 15, 0]])
    assert sim.color_similarity(colors, PAIR, 15.0) == pytest.approx([np.exp(-0.5)])
    assert sim.color_similarity(np.array([[0.2], [0.3]]), PAIR, 0.1) == pytest.approx([np.exp(-0.5)])


def test_scale():
    extents = np.array([[4.0, 2, 1], [2, 2, 0.5], [0, 0, 0], [1, 0, 0]])
    pairs = np.array([[0, 1], [0, 2], [2, 3]])
    assert sim.scale_similarity(extents, pairs).tolist() == pytest.approx([(0.5 + 1 + 0.5) / 3, 0, 2 / 3])


def test_semantics_at_the_edge_of_confidence():
    rows = np.array([[1.0, 0], [0.75, 0.25], [0.25, 0.75], [np.nan, np.nan]])
    same, other, missing = sim.semantic_similarity(rows, np.array([[0, 1], [1, 2], [0, 3]]), 2.0)
    assert same == pytest.approx(0.7788, abs=1e-4)
    assert other == pytest.approx(0.3679, abs=1e-4)
    assert np.isnan(missing)


def test_affinity_drops_what_is_missing():
    normal, descriptor = np.array([0.6, 0.6, np.nan]), np.array([0.8, np.nan, np.nan])
    value = sim.affinity(normal, descriptor)
    assert value[:2] == pytest.approx([np.sqrt((0.36 + 0.64) / 2), 0.6])
    assert np.isnan(value[2])
    assert sim.affinity(normal, descriptor, 3.0, 1.0)[0] == pytest.approx(np.sqrt((3 * 0.36 + 0.64) / 4))
    assert sim.affinity(None, np.array([-0.5])).tolist() == [0.0]
    with pytest.raises(ValueError, match='switched off'):
        sim.affinity(None, None)


def similarity(graph, rows, rules, round):
    return sim.weigh(sim.pair_terms(graph, rules), graph.edges, rows, rules, round)


def graph(colors):
    return RegionGraph(
        centroids=np.zeros((2, 3)),
        normals=np.array([[0.0, 0, 1], [0, 0, -1]]),
        curvatures=np.zeros(2),
        descriptors=np.array([[1.0, 0], [0, 1]]),
        colors=colors,
        extents=np.ones((2, 3)),
        sizes=np.ones(2, dtype=np.int64),
        edges=PAIR,
    )


def test_a_missing_term_leaves_sum_and_normaliser():
    rows = np.array([[1.0, 0], [1, 0]])
    affinity = np.sqrt(0.5)  # normals agree whatever their sign, descriptors do not
    with_color = similarity(graph(np.array([[50.0, 0, 0]] * 2)), rows, MergeRules(), 2)
    assert with_color.total == pytest.approx([0.75 * (2 + affinity) + 0.25])
    assert with_color.mean == pytest.approx(with_color.total / 2.5)
    without = similarity(graph(None), rows, MergeRules(), 2)
    assert without.total == pytest.approx([0.75 * (1 + affinity) + 0.25])
    assert without.mean == pytest.approx(without.total / 1.75)
    assert np.isnan(without.color).all()
    unseen = similarity(graph(None), np.full((2, 2), np.nan), MergeRules(), 2)
    assert unseen.mean == pytest.approx([(1 + affinity) / 2])
    last = similarity(graph(None), np.full((2, 2), np.nan), MergeRules(), 8)
    assert (last.total.tolist(), last.mean.tolist()) == ([0.0], [0.0])


def test_terms_and_affinities_that_are_left_out():
    rows = np.array([[1.0, 0], [1, 0]])
    settings = {
        'scale': {'without': ['scale']},
        'descriptor': {'without': ['descriptor']},
        'A_n': {'lambda_normal': 0.0},
        'A_des': {'lambda_descriptor': 0.0},
    }
    value = {name: similarity(graph(None), rows, MergeRules(**given), 0).mean[0] for name, given in settings.items()}
    assert value == pytest.approx({'scale': np.sqrt(0.5), 'descriptor': 1.0, 'A_n': 0.5, 'A_des': 1.0})
    both_off = MergeRules(lambda_normal=0.0, lambda_descriptor=0.0)
    assert np.isnan(similarity(graph(None), rows, both_off, 0).descriptor).all()
    nothing = sim.affinity(np.array([0.6]), None)
    assert sim.affinity(np.array([0.6]), np.array([0.3]), 2.0, 0.0).tolist() == nothing.tolist()


@pytest.mark.parametrize('name', ['color', 'scale', 'descriptor', 'semantics'])
@pytest.mark.parametrize('thresholds', ['normalised', 'literal'])
def test_a_term_that_is_off_counts_as_little_as_one_that_is_missing(name, thresholds):
    rng = np.random.default_rng(0)
    terms = sim.PairTerms(*rng.random((4, 5)))
    rows, edges = rng.dirichlet(np.ones(3), 6), np.stack([np.arange(5), np.arange(1, 6)], axis=1)
    for balanced in (True, False):
        settings = {'thresholds': thresholds, 'weight_balancing': balanced}
        off = sim.weigh(terms, edges, rows, MergeRules(**settings, without=(name,)), 3)
        whole = sim.weigh(terms, edges, rows, MergeRules(**settings), 3)
        table = np.stack([whole.color, whole.scale, whole.descriptor, whole.semantics])
        y = np.array(MergeRules(**settings).weights(3))
        left = np.array([n != name for n in ('color', 'scale', 'descriptor', 'semantics')])
        np.testing.assert_allclose(off.total, (y[:, None] * table)[left].sum(axis=0), rtol=1e-15)
        np.testing.assert_allclose(off.mean, off.total / y[left].sum(), rtol=1e-15)
        np.testing.assert_array_equal(getattr(off, name), getattr(whole, name))  # known, though it weighs nothing


def test_without_the_networks_term_the_last_round_still_has_a_mean():
    assert MergeRules(without=('semantics',)).weights(8) == (1, 1, 1, 0)
    assert MergeRules(without=('semantics', 'scale')).weights(8) == (1, 0, 1, 0)
    assert MergeRules(without=('semantics',), thresholds='literal').weights(8) == (0, 0, 0, 0)
    everything = ('color', 'scale', 'descriptor', 'semantics')
    assert MergeRules(without=everything).weights(8) == (0, 0, 0, 0)


def test_no_edges():
    empty = RegionGraph(
        *(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 4)), None, np.zeros((0, 3))),
        sizes=np.zeros(0, dtype=np.int64),
        edges=np.zeros((0, 2), dtype=np.int64),
    )
    assert len(similarity(empty, np.zeros((0, 2)), MergeRules(), 3).mean) == 0
