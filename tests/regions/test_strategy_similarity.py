"""Schedule, thresholds and the similarities, by hand."""

import numpy as np
import pytest

from rm3d_plugin.regions import MergeStrategy
from rm3d_plugin.regions import similarity as sim
from rm3d_plugin.structures import RegionGraph

PAIR = np.array([[0, 1]])


def test_the_weights_go_from_geometry_to_semantics():
    strategy = MergeStrategy(rounds=8)
    assert strategy.weights(0) == (1, 1, 1, 0)
    assert strategy.weights(4) == (0.5, 0.5, 0.5, 0.5)
    assert strategy.weights(8) == (0, 0, 0, 1)
    assert MergeStrategy(weight_balancing=False).weights(3) == (1, 1, 1, 1)
    off = MergeStrategy(weight_balancing=False, use_color=False, use_semantics=False)
    assert off.weights(3) == (0, 1, 1, 0)
    with pytest.raises(ValueError, match=r'0\.\.8, got 9'):
        strategy.weights(9)


def test_normalised_and_literal_thresholds_agree_in_the_middle():
    normalised, literal = MergeStrategy(), MergeStrategy(thresholds='literal')
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
        ('quota', 0),
        ('quota', 1.5),
        ('quota_ranges', (5, 5)),
        ('quota_ranges', (-1, 5)),
        ('holdout', 1),
        ('holdout', -0.1),
        ('holdout_margin', 2),
        ('use_color', 1),
        ('permanent', 'yes'),
    ],
)
def test_a_bad_value_is_named(field, value):
    with pytest.raises(ValueError, match=rf'MergeStrategy\.{field}: expected .* got'):
        MergeStrategy(**{field: value})


def test_centre_limits():
    classes = np.array([0, 1, -1])
    assert MergeStrategy().centre_limit(classes).tolist() == [np.inf] * 3
    assert MergeStrategy(centre_distance=0.3).centre_limit(classes).tolist() == [0.3] * 3
    assert MergeStrategy(centre_distance=[1.0, None]).centre_limit(classes).tolist() == [1.0, np.inf, np.inf]


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
    with_color = sim.region_similarity(graph(np.array([[50.0, 0, 0]] * 2)), rows, MergeStrategy(), 2)
    assert with_color.total == pytest.approx([0.75 * (2 + affinity) + 0.25])
    assert with_color.mean == pytest.approx(with_color.total / 2.5)
    without = sim.region_similarity(graph(None), rows, MergeStrategy(), 2)
    assert without.total == pytest.approx([0.75 * (1 + affinity) + 0.25])
    assert without.mean == pytest.approx(without.total / 1.75)
    assert np.isnan(without.color).all()
    unseen = sim.region_similarity(graph(None), np.full((2, 2), np.nan), MergeStrategy(), 2)
    assert unseen.mean == pytest.approx([(1 + affinity) / 2])
    last = sim.region_similarity(graph(None), np.full((2, 2), np.nan), MergeStrategy(), 8)
    assert (last.total.tolist(), last.mean.tolist()) == ([0.0], [0.0])


def test_switches():
    rows = np.array([[1.0, 0], [1, 0]])
    value = {
        name: sim.region_similarity(graph(None), rows, MergeStrategy(**{name: False}), 0).mean[0]
        for name in ('use_scale', 'use_descriptor', 'use_normal_affinity', 'use_descriptor_affinity')
    }
    assert value == pytest.approx(
        {
            'use_scale': np.sqrt(0.5),
            'use_descriptor': 1.0,
            'use_normal_affinity': 0.5,
            'use_descriptor_affinity': 1.0,
        }
    )
    both_off = MergeStrategy(use_normal_affinity=False, use_descriptor_affinity=False)
    assert np.isnan(sim.region_similarity(graph(None), rows, both_off, 0).descriptor).all()


@pytest.mark.parametrize('name', ['color', 'scale', 'descriptor', 'semantics'])
@pytest.mark.parametrize('thresholds', ['normalised', 'literal'])
def test_a_term_that_is_off_counts_as_little_as_one_that_is_missing(name, thresholds):
    rng = np.random.default_rng(0)
    terms = sim.PairTerms(*rng.random((4, 5)))
    rows, edges = rng.dirichlet(np.ones(3), 6), np.stack([np.arange(5), np.arange(1, 6)], axis=1)
    for balanced in (True, False):
        settings = {'thresholds': thresholds, 'weight_balancing': balanced}
        off = sim.weigh(terms, edges, rows, MergeStrategy(**settings, **{f'use_{name}': False}), 3)
        whole = sim.weigh(terms, edges, rows, MergeStrategy(**settings), 3)
        table = np.stack([whole.color, whole.scale, whole.descriptor, whole.semantics])
        y = np.array(MergeStrategy(**settings).weights(3))
        left = np.array([n != name for n in ('color', 'scale', 'descriptor', 'semantics')])
        np.testing.assert_allclose(off.total, (y[:, None] * table)[left].sum(axis=0), rtol=1e-15)
        np.testing.assert_allclose(off.mean, off.total / y[left].sum(), rtol=1e-15)
        np.testing.assert_array_equal(getattr(off, name), getattr(whole, name))  # known, though it weighs nothing


def test_without_the_networks_term_the_last_round_still_has_a_mean():
    assert MergeStrategy(use_semantics=False).weights(8) == (1, 1, 1, 0)
    assert MergeStrategy(use_semantics=False, use_scale=False).weights(8) == (1, 0, 1, 0)
    assert MergeStrategy(use_semantics=False, thresholds='literal').weights(8) == (0, 0, 0, 0)
    everything_off = {f'use_{name}': False for name in ('color', 'scale', 'descriptor', 'semantics')}
    assert MergeStrategy(**everything_off).weights(8) == (0, 0, 0, 0)


def test_no_edges():
    empty = RegionGraph(
        *(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 4)), None, np.zeros((0, 3))),
        sizes=np.zeros(0, dtype=np.int64),
        edges=np.zeros((0, 2), dtype=np.int64),
    )
    assert len(sim.region_similarity(empty, np.zeros((0, 2)), MergeStrategy(), 3).mean) == 0
