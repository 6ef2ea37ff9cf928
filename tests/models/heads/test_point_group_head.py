import numpy as np
import pytest

from rm3d_plugin.models.heads import PointGroupHead, ProposalRules, find_instances

# ---------------------------------------------------------------------- proposals


def heap(center, count, seed, spread=0.01):
    return np.asarray(center, dtype=float) + np.random.default_rng(seed).uniform(-spread, spread, (count, 3))


def probs_of(classes, sure=0.8, num=3):
    out = np.full((len(classes), num), (1 - sure) / (num - 1))
    out[np.arange(len(classes)), classes] = sure
    return out


def test_instances_by_hand():
    xyz = np.concatenate(
        [heap((0, 0, 0), 60, 0), heap((1, 0, 0), 40, 1), heap((2, 0, 0), 60, 2), heap((3, 0, 0), 9, 3)]
    )
    classes = np.repeat([1, 1, 0, 2], [60, 40, 60, 9])
    probs = probs_of(classes)
    probs[60:100] = probs_of(classes[60:100], 0.9)
    rules = ProposalRules(radius=0.05, cluster_points=10, min_points=39)
    found = find_instances(xyz, xyz, probs, (1, 2), rules)
    assert found.labels.tolist() == [1, 1] and found.scores.tolist() == pytest.approx([0.9, 0.8])
    assert found.masks.shape == (2, 169) and found.masks.sum(1).tolist() == [40, 60]  # twins are suppressed
    assert found.masks[0, 60:100].all() and found.masks[1, :60].all()
    assert found.scores.dtype == np.float32 and found.labels.dtype == np.int64
    assert find_instances(xyz, xyz, probs, (1, 2), ProposalRules(0.05, 10, 40)).labels.tolist() == [1]  # more than 40
    assert find_instances(xyz, xyz, probs, (), rules).masks.shape == (0, 169)
    only = find_instances(xyz, xyz, probs, (1, 2), ProposalRules(0.05, 10, 5, max_instances=2, min_score=0.85))
    assert only.scores.tolist() == pytest.approx([0.9])


def test_shifted_points_part_what_touches_and_join_what_is_broken():
    left, right = heap((0, 0, 0), 60, 0, 0.05), heap((0.1, 0, 0), 60, 1, 0.05)  # two objects side by side
    xyz = np.concatenate([left, right])
    shifted = np.repeat([[0.0, 0, 0], [0.1, 0, 0]], 60, axis=0)
    probs = probs_of(np.ones(120, dtype=int))
    rules = dict(radius=0.04, cluster_points=20, min_points=20)
    assert find_instances(xyz, xyz, probs, (1,), ProposalRules(**rules)).masks.sum(1).tolist() == [120]
    parts = find_instances(xyz, shifted, probs, (1,), ProposalRules(**rules, coordinates='shifted'))
    assert [mask.nonzero()[0].tolist() for mask in parts.masks] == [list(range(60)), list(range(60, 120))]
    both = find_instances(xyz, shifted, probs, (1,), ProposalRules(**rules))
    assert both.masks.sum(1).tolist() == [60, 60]  # equal scores: the shifted clusters come first
    assert find_instances(xyz, shifted, probs, (1,), ProposalRules(**rules, coordinates='original')).masks.sum() == 120


def test_no_point_and_no_cluster():
    empty = np.zeros((0, 3))
    assert find_instances(empty, empty, empty, (1,), ProposalRules()).masks.shape == (0, 0)
    one = np.zeros((1, 3))
    assert find_instances(one, one, probs_of([1]), (1,), ProposalRules()).masks.shape == (0, 1)
    assert find_instances(one, one, probs_of([1]), (1,), ProposalRules(0.1, 1, 0)).masks.tolist() == [[True]]


def test_bad_rules_are_told():
    with pytest.raises(ValueError, match='radius > 0'):
        PointGroupHead(4, proposals=dict(radius=0.0))
