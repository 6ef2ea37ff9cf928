"""A round decided again: the same thresholds change nothing, others change what a refresh with them would."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels import refreshing
from pseudo_labels.patches import CLASSES, make_patches

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import SegmentationRules, SelfTrainingRules
from rm3d_plugin.pseudo_labels.common.ledger import extreme_merges
from rm3d_plugin.regions import MergeLedger, MergeRules, Reason
from rm3d_plugin.reporting.replay import (
    ReplayRules,
    RoundOfLabels,
    changed_rules,
    decide_again,
    format_extremes,
    format_replay,
)
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import Boxes3D, SceneError

MERGE = MergeRules(gamma=0.5, centre_distance=(1.5, None, 2.0), rounds=4)
RULES = ReplayRules(MERGE)
ROUNDS = 3


class Scenes(LabelSource):
    classes = ('a', 'b', 'c')

    def __init__(self, patches):
        self.patches = patches
        self.scene_ids = [f's{i}' for i in range(len(patches))]

    def load_cloud(self, index):
        return self.patches[index].cloud

    def annotated_labels(self, index):
        return self.patches[index].annotated

    def truth(self, index):
        return Truth(Boxes3D.empty(), self.patches[index].truth)


def refresh(patches, number, previous, rules=RULES):
    rng = np.random.default_rng(number)
    rows = centers = None
    if number:
        rows = patches.softmax(rng, noise=0.9)
        rows[rng.random(len(rows)) < 0.05] = np.nan
        centers = patches.graph.centroids[patches.regions.labels] + rng.normal(0, 0.2, (len(rows), 3))
    scene = refreshing.inputs(patches, rows=rows, centers=centers, previous=previous)
    rules = SegmentationRules(rules.merge, self_training=rules.self_training)
    return refreshing.points(scene, rules, number, patches.counts, (0, 1))


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Two scenes, three rounds, as a label_maker writes them."""
    patches = [make_patches(seed, share=0.02) for seed in range(2)]
    store = LabelStore(tmp_path_factory.mktemp('run') / 'labels')
    for number in range(ROUNDS):
        store.begin_round(number)
        for i, scene in enumerate(patches):
            previous = store.read(f's{i}', number - 1) if number else None
            result = refresh(scene, number, previous)
            store.write(number, f's{i}', result.labels, result.merge.ledger.to_arrays())
        store.finish_round(number)
    store.set_current(ROUNDS - 1)
    return store, patches


def read(store, scene, number):
    ledger = MergeLedger.from_arrays(store.read_ledger(scene, number))
    return ledger, store.read(scene, number), store.read(scene, number - 1) if number else None


@pytest.mark.parametrize('number', range(ROUNDS))
def test_the_same_thresholds_give_the_very_same_labels(run, number):
    store, _ = run
    for scene in ('s0', 's1'):
        ledger, stored, previous = read(store, scene, number)
        again = decide_again(ledger, stored, previous)
        np.testing.assert_array_equal(again.semantic, stored.semantic)
        for name, column in ledger.columns().items():
            np.testing.assert_array_equal(getattr(again.merge.ledger, name), column)


@pytest.mark.parametrize(
    'changes',
    [
        {'gamma': 0.6},
        {'tau_merge': 1.5, 'tau_seed': 1.7},
        {'thresholds': 'literal'},
        {'weight_balancing': False},
        {'without': ['color']},
        {'without': ['scale']},
        {'without': ['descriptor']},
        {'without': ['semantics']},
        {'lambda_normal': 0.0},
        {'lambda_descriptor': 0.0},
        {'lambda_seg': 8.0, 'lambda_normal': 0.2},
        {'demote_margin': 0.15, 'gamma': 0.75},
        {'cbst_fraction': 0.3},
        {'centre_distance': None, 'seed_share': 0.2},
    ],
)
def test_other_thresholds_give_what_a_refresh_with_them_gives(run, changes):
    store, patches = run
    ledger, stored, previous = read(store, 's0', 2)
    limits = {name: changes[name] for name in changes if name.startswith('cbst')}
    others = {name: changes[name] for name in changes if name not in limits}
    rules = ReplayRules(replace(MERGE, **others), SelfTrainingRules(**limits))
    assert changed_rules(RULES, changes) == rules
    want = refresh(patches[0], 2, previous, rules)
    got = decide_again(ledger, stored, previous, rules)
    np.testing.assert_array_equal(got.merge.group, want.merge.group)
    np.testing.assert_array_equal(got.semantic, want.labels.semantic)


def test_the_round_is_compared_and_scored(run):
    store, patches = run
    chosen = RoundOfLabels(store.root, 2, source=Scenes(patches))
    same = chosen.replay({'gamma': MERGE.gamma})
    assert all(c.labels_changed == 0 and c.merges_changed == 0 for c in same.values())
    strict = chosen.replay({'tau': 0.85, 'gamma': 0.7, 'demote_margin': 0.15})
    total = strict['s0'] + strict['s1']
    assert total.merges[1] < total.merges[0] and total.merges_changed > 0 and total.labels_changed > 0
    before = [store.read(s, 2) for s in ('s0', 's1')]
    assert total.labelled[0] == sum(int((labels.semantic >= 0).sum()) for labels in before)
    compared = [(b.semantic >= 0) & ~b.point_is_annotated for b in before]
    assert total.compared[0] == sum(int(j.sum()) for j in compared)
    pairs = zip(before, compared, patches, strict=True)
    assert total.correct[0] == sum(int((b.semantic == p.truth)[j].sum()) for b, j, p in pairs)
    text = format_replay(strict, {'tau': 0.85})
    assert 'precision' in text and text.splitlines()[-1].startswith('all: merges')
    blind = RoundOfLabels(store.root, 2, 's1').replay({'tau': 0.85})
    assert list(blind) == ['s1'] and 'precision' not in format_replay(blind, {'tau': 0.85})


def test_tau_is_what_the_compared_value_must_reach():
    assert changed_rules(RULES, {'tau': 0.7}).merge.merge_threshold() == pytest.approx(0.7)
    assert changed_rules(RULES, {'tau': 0.7}).merge.seed_threshold() == 0.75
    assert changed_rules(RULES, {'tau': 0.9}).merge.seed_threshold() == pytest.approx(0.9)
    literal = changed_rules(RULES, {'tau': 1.1, 'thresholds': 'literal'}).merge
    assert (literal.merge_threshold(), literal.tau_merge) == (1.1, 1.1)


@pytest.mark.parametrize(
    'changes, message',
    [
        ({'gama': 0.7}, 'gama: is no threshold or switch. Expected any of tau, tau_merge'),
        ({'pooling': 'max'}, 'pooling: is decided before the ledger is written'),
        ({'gamma': 7}, r'MergeRules\.gamma: expected a probability'),
        ({'tau': 'high'}, 'high'),
    ],
)
def test_what_cannot_be_replayed_is_named(changes, message):
    with pytest.raises(ConfigError, match=message):
        changed_rules(RULES, changes)


def test_rounds_and_scenes_that_are_not_there(run, tmp_path):
    store, patches = run
    with pytest.raises(SceneError, match='round 7'):
        RoundOfLabels(store.root, 7)
    with pytest.raises(SceneError, match='--scene nowhere: round 2'):
        RoundOfLabels(store.root, None, 'nowhere')
    bare = LabelStore(tmp_path)
    bare.begin_round(0)
    bare.write(0, 's0', store.read('s0', 0))
    bare.finish_round(0)
    with pytest.raises(SceneError, match='round 0 has no ledger'):
        RoundOfLabels(tmp_path, 0)
    bare.begin_round(1)
    old = {k: v for k, v in store.read_ledger('s0', 1).items() if not k.startswith('known.')}
    bare.write(1, 's0', store.read('s0', 1), old)
    bare.finish_round(1)
    with pytest.raises(SceneError, match='holds no record'):
        RoundOfLabels(tmp_path, 1).replay({'tau': 0.7})
    with pytest.raises(SceneError, match='data changed'):
        RoundOfLabels(store.root, 2, source=Scenes([replace_truth(patches[0])])).replay({'tau': 0.7})


def replace_truth(patches):
    return replace(patches, truth=patches.truth[:-1])


def test_strongest_and_weakest(run):
    store, _ = run
    ledger, _, _ = read(store, 's0', 2)
    found = extreme_merges(ledger, 3)
    merged = ledger.Sbar[ledger.accepted]
    assert ledger.Sbar[found.strongest].tolist() == sorted(merged, reverse=True)[:3]
    assert ledger.Sbar[found.weakest].tolist() == sorted(merged)[:3]
    assert (ledger.reason[found.refused] == Reason.NOT_SIMILAR).all()
    text = format_extremes(RoundOfLabels(store.root, 2), 2)
    assert text.count('merged') == 4 and 's0: round 2: regions' in text
    assert format_extremes(RoundOfLabels(store.root, 0, 's0'), 2).startswith('strongest merges')


def test_the_record_is_small(run):
    store, patches = run
    size = store.ledger_path(2, 's0').stat().st_size
    assert size < 40 * len(patches[0].graph.edges) * 8
    assert CLASSES == 3
