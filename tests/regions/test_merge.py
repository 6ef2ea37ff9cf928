"""Conditions 3 and 4, against hand-worked cases and a slow twin."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.merge_slow import merge as slow_merge

from rm3d_plugin.regions import MergeLedger, MergeRules, Reason, RegionEvidence, merge
from rm3d_plugin.structures import RegionGraph

GEOMETRY = MergeRules(seed_share=0.0)


def chain(n, extents=None):
    """n regions in a row, alike in everything that is not given."""
    return RegionGraph(
        centroids=np.arange(n)[:, None] * np.array([[1.0, 0, 0]]),
        normals=np.tile([0.0, 0, 1], (n, 1)),
        curvatures=np.arange(n) / 100,
        descriptors=np.ones((n, 2)),
        colors=None,
        extents=np.ones((n, 3)) if extents is None else np.asarray(extents, dtype=float),
        sizes=np.ones(n, dtype=np.int64),
        edges=np.stack([np.arange(n - 1), np.arange(1, n)], axis=1) if n else np.zeros((0, 2), dtype=np.int64),
    )


def random_graph(rng, n, color=True):
    edges = np.unique(np.sort(rng.integers(0, n, (3 * n, 2)), axis=1), axis=0)
    return RegionGraph(
        centroids=rng.normal(size=(n, 3)),
        normals=rng.normal(size=(n, 3)),
        curvatures=rng.random(n) / 3,
        descriptors=rng.random((n, 5)) ** 3,
        colors=rng.random((n, 3)) * 40 if color else None,
        extents=np.sort(rng.random((n, 3)) + 0.2, axis=1)[:, ::-1],
        sizes=rng.integers(1, 50, n),
        edges=edges[edges[:, 0] < edges[:, 1]],
    )


def run(graph, probabilities, labels=None, rules=GEOMETRY, round=4, instances=None, centers=None):
    unknown = np.full(len(graph), -1)
    labels = unknown if labels is None else np.asarray(labels)
    instances = unknown if instances is None else instances
    return merge(
        graph, RegionEvidence(np.asarray(probabilities, dtype=float), labels, instances, centers), rules, round
    )


def test_confident_agreement_merges():
    result = run(chain(2), [[0.9, 0.1], [0.8, 0.2]])
    assert result.group.tolist() == [0, 0]
    assert result.ledger.reason.tolist() == [Reason.MERGED]
    assert result.ledger.became_seed.tolist() == [True]


@pytest.mark.parametrize(
    'rows, reason',
    [
        ([[0.9, 0.1], [0.1, 0.9]], Reason.OTHER_CLASS),  # confident disagreement
        ([[0.9, 0.1], [0.7, 0.3]], Reason.NOT_CONFIDENT),
        ([[0.9, 0.1], [np.nan, np.nan]], Reason.NOT_CONFIDENT),
    ],
)
def test_no_merge_without_confident_agreement(rows, reason):
    for round in range(9):
        result = run(chain(2), rows, round=round)
        assert result.group.tolist() == [0, 1]
        assert result.ledger.reason.tolist() == [reason]


def test_confidence_includes_gamma():
    assert run(chain(2), [[0.75, 0.25], [0.75, 0.25]]).group.tolist() == [0, 0]


def test_a_labelled_region_needs_no_confidence_and_its_label_replaces_the_prediction():
    rows = [[0.1, 0.9], [0.9, 0.1], [0.1, 0.9]]
    result = run(chain(3), rows, labels=[0, -1, -1])
    assert result.group.tolist() == [0, 0, 1]


def test_labelled_regions_of_two_classes_never_meet():
    rows = np.full((3, 2), 0.5)
    assert run(chain(3), rows, labels=[0, 1, 0]).group.tolist() == [0, 1, 2]


def test_no_merge_across_classes_in_the_first_round_without_predictions():
    result = run(chain(4), np.zeros((4, 0)), labels=[1, 1, -1, 0], round=0)
    assert result.group.tolist() == [0, 0, 1, 2]


def test_two_annotated_instances_never_end_in_one_group():
    # The middle region is claimed by one of them; the other must stay apart even through it.
    rows = np.tile([0.9, 0.1], (3, 1))
    result = run(chain(3), rows, labels=[0, -1, 0], instances=np.array([5, -1, 6]))
    assert result.group.tolist() == [0, 0, 1]
    assert result.ledger.reason.tolist() == [Reason.MERGED, Reason.OTHER_INSTANCE]
    same = run(chain(3), rows, labels=[0, -1, 0], instances=np.array([5, -1, 5]))
    assert same.group.tolist() == [0, 0, 0]


def test_condition_4_stops_a_chain_and_condition_3_alone_does_not_carry_it_on():
    # Extents halve once: M_scale = 1/2, others 1; Sbar at t = 0 without colour = (.5 + 1) / 2 = .75 exactly, then
    # .7 < .75 with a smaller ratio: merged, but no seed.
    rows = np.tile([0.9, 0.1], (3, 1))
    grows = run(chain(3, extents=[[1] * 3, [0.5] * 3, [0.5] * 3]), rows, round=0)
    assert grows.group.tolist() == [0, 0, 0]
    assert grows.ledger.Sbar.tolist() == [0.75, 1.0]
    stops = run(chain(3, extents=[[1] * 3, [0.4] * 3, [0.16] * 3]), rows, round=0)
    assert stops.ledger.Sbar == pytest.approx([0.7, 0.7])
    assert stops.group.tolist() == [0, 0, 1]
    assert stops.ledger.became_seed.tolist() == [False, False]
    assert stops.ledger.reason.tolist() == [Reason.MERGED, Reason.NOT_REACHED]


def test_the_best_edge_takes_a_contested_region_and_ties_go_to_the_lowest():
    rows = np.tile([0.9, 0.1], (3, 1))
    instances = np.array([0, -1, 1])
    tie = run(chain(3), rows, labels=[0, -1, 0], instances=instances)
    assert tie.group.tolist() == [0, 0, 1]
    better = run(chain(3, extents=[[0.9] * 3, [1] * 3, [1] * 3]), rows, labels=[0, -1, 0], instances=instances)
    assert better.group.tolist() == [0, 1, 1]


def test_literal_thresholds_close_when_the_printed_sums_cannot_be_reached():
    rows = np.tile([1.0, 0.0], (2, 1))
    literal = replace(GEOMETRY, thresholds='literal')
    # Without colour S = 2 (1 - t) + t = 2 - t at most: Condition 3 fails from t > .75 on, Condition 4 from t > .5.
    merged = [bool(run(chain(2), rows, rules=literal, round=r).ledger.accepted[0]) for r in range(9)]
    seeds = [bool(run(chain(2), rows, rules=literal, round=r).ledger.became_seed[0]) for r in range(9)]
    assert merged == [True] * 7 + [False] * 2
    assert seeds == [True] * 5 + [False] * 4
    assert all(run(chain(2), rows, round=r).ledger.accepted[0] for r in range(9))


def test_shifted_centres_separate_instances_by_class():
    rows = [[0.9, 0.1], [0.9, 0.1], [0.1, 0.9], [0.1, 0.9]]
    graph = chain(4)
    centers = np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 0, 0], [0.5, 0, 0]])
    both = replace(GEOMETRY, centre_distance=0.3)
    one = replace(GEOMETRY, centre_distance=(0.3, None))
    assert run(graph, rows, centers=centers).group.tolist() == [0, 0, 1, 1]
    assert run(graph, rows, rules=both, centers=centers).group.tolist() == [0, 1, 2, 3]
    assert run(graph, rows, rules=one, centers=centers).group.tolist() == [0, 1, 2, 2]
    unknown = np.where(np.arange(4)[:, None] == 1, np.nan, centers)
    assert run(graph, rows, rules=one, centers=unknown).group.tolist() == [0, 0, 1, 1]
    with pytest.raises(ValueError, match='centre_distance'):
        run(graph, rows, rules=replace(GEOMETRY, centre_distance=(0.3,)), centers=centers)


@pytest.mark.parametrize('n', [0, 1])
def test_nothing_to_merge(n):
    result = run(chain(n), np.zeros((n, 3)))
    assert result.group.tolist() == list(range(n))
    assert len(result.ledger) == 0


def test_errors_name_what_does_not_fit():
    with pytest.raises(ValueError, match='probabilities: has 3 rows, expected 2'):
        run(chain(2), np.zeros((3, 2)))
    with pytest.raises(ValueError, match='class 2, but probabilities have 2 columns'):
        run(chain(2), np.full((2, 2), 0.5), labels=[2, -1])


def test_the_ledger_survives_a_round_trip_and_selects():
    ledger = run(chain(4), np.tile([0.9, 0.1], (4, 1)), labels=[-1, 0, -1, 1]).ledger
    again = MergeLedger.from_arrays(ledger.to_arrays())
    for name, column in ledger.to_arrays().items():
        np.testing.assert_array_equal(column, again.to_arrays()[name])
    assert len(ledger.select(ledger.accepted)) == int(ledger.accepted.sum())
    old = {k: v for k, v in ledger.to_arrays().items() if k != 'format'}
    with pytest.raises(ValueError, match='has format 1, this version reads 2; make the labels of that run again'):
        MergeLedger.from_arrays(old)
    with pytest.raises(ValueError, match=r"\['S'\] are missing"):
        MergeLedger.from_arrays({k: v for k, v in ledger.to_arrays().items() if k != 'S'})


def scene(seed, n, color=True):
    rng = np.random.default_rng(seed)
    graph = random_graph(rng, n, color)
    rows = rng.dirichlet(np.full(3, 0.15), n)
    rows[rng.random(n) < 0.1] = np.nan
    labels = np.where(rng.random(n) < 0.2, rng.integers(0, 3, n), -1)
    instances = np.where((labels >= 0) & (rng.random(n) < 0.7), rng.integers(0, 4, n), -1)
    return graph, rows, labels, instances


def as_sets(group):
    return {frozenset(np.flatnonzero(group == g).tolist()) for g in np.unique(group)}


@pytest.mark.parametrize('seed', range(12))
@pytest.mark.parametrize('thresholds', ['normalised', 'literal'])
def test_equals_the_slow_twin(seed, thresholds):
    graph, rows, labels, instances = scene(seed, 40, color=seed % 2 == 0)
    rules = MergeRules(thresholds=thresholds, seed_share=0.05)
    for round in (1, 4, 8):
        fast = run(graph, rows, labels, rules, round, instances=instances)
        slow = slow_merge(graph, rows.tolist(), labels.tolist(), instances.tolist(), rules, round)
        assert as_sets(fast.group) == slow


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), n=st.integers(2, 40), round=st.integers(0, 8))
def test_properties(seed, n, round):
    graph, rows, labels, instances = scene(seed, n)
    result = run(graph, rows, labels, MergeRules(), round, instances=instances)
    classes = np.where(labels >= 0, labels, np.nan_to_num(rows).argmax(axis=1))
    assert result.group[0] == 0 and (np.diff(np.unique(result.group)) == 1).all()
    for members in as_sets(result.group):
        index = sorted(members)
        assert len(set(classes[index])) == 1 or len(index) == 1
        assert len(set(instances[index]) - {-1}) <= 1
    # Every accepted pair joins two groups: as many merges as groups lost.
    assert int(result.ledger.accepted.sum()) == n - len(np.unique(result.group))
    # Renaming the regions renames the groups, where no two pairs are equally alike (labelled ones are in the end).
    if round == 8:
        return
    order = np.random.default_rng(seed).permutation(n)
    place = np.argsort(order)
    edges = np.sort(place[graph.edges], axis=1)
    edges = edges[np.lexsort((edges[:, 1], edges[:, 0]))].reshape(-1, 2)
    renamed = RegionGraph(
        *(getattr(graph, f)[order] for f in ('centroids', 'normals', 'curvatures', 'descriptors', 'colors')),
        extents=graph.extents[order],
        sizes=graph.sizes[order],
        edges=edges,
    )
    again = run(renamed, rows[order], labels[order], MergeRules(), round, instances=instances[order])
    assert as_sets(again.group[place]) == as_sets(result.group)
