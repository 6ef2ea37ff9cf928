"""Labels of a segmentation run: spread from annotated points over regions, round by round."""

import numpy as np
import pytest
from labeling import rounds
from reference.toy_scenes import ToyRooms, make_scene

from rm3d_plugin.evaluation.functional import SceneTruth
from rm3d_plugin.label_budgets import BudgetError
from rm3d_plugin.labeling import AnnotatedLabelMaker, PointBudgetSource, SegmentationLabelMaker
from rm3d_plugin.labeling.round_summary import describe_round, summarise_points
from rm3d_plugin.labeling.sources import LabelSource
from rm3d_plugin.pseudo_labels import PointPrediction, SceneInputs, SegmentationRules
from rm3d_plugin.pseudo_labels.ground import classifier as ground_classifier
from rm3d_plugin.pseudo_labels.region_prior.features import prior_features
from rm3d_plugin.regions import MergeRules
from rm3d_plugin.storage.files import write_npz
from rm3d_plugin.storage.label_store import LabelStoreError
from rm3d_plugin.structures import Boxes3D, PseudoLabels


def label_maker(tmp_path, budget='20pts', seed=0, **settings):
    return SegmentationLabelMaker(
        store=tmp_path / 'labels',
        cache=tmp_path / 'geometry',
        source=PointBudgetSource(ToyRooms(2), budget, seed),
        descriptor={'type': 'AdaptedPFH', 'radius': 0.15, 'max_neighbors': 16},
        oversegmenter={'type': 'RegionGrowing', 'threshold': 0.9, 'max_edge': 0.25, 'min_region': 10},
        **settings,
    )


def certain(truth, sure=0.95):
    """A prediction that is right everywhere."""
    probabilities = np.full((len(truth.semantic), 3), (1 - sure) / 2, dtype=np.float32)
    probabilities[np.arange(len(truth.semantic)), np.maximum(truth.semantic, 0)] = sure
    return PointPrediction(probabilities, None)


def test_annotated_points_label_their_regions_and_predictions_the_rest(tmp_path):
    told = []
    made = label_maker(tmp_path)
    rounds.start(made, log=told.append)
    assert 'Label budget' in told[0] and 'labels of round 0: coverage' in told[1]
    first = made.store.summary(0)
    assert 0.3 < first['coverage'] < 1 and first['precision'] > 0.9 and first['truth_known']
    assert first['offset_error'] < 0.5
    labels, annotated = made.store.read('room0', 0), made.annotated('room0')
    shown = annotated.semantic >= 0
    np.testing.assert_array_equal(labels.point_is_annotated, shown)
    np.testing.assert_array_equal(labels.semantic[shown], annotated.semantic[shown])
    assert (labels.instance[labels.semantic != 1] == -1).all()
    made.begin(1)
    for scene, index in made.index_of.items():
        made.refresh(1, scene, certain(made.source.truth(index)))
    rounds.close(made, 1, told.append)
    second = made.store.summary(1)
    assert second['coverage'] > first['coverage']
    assert made.store.read_ledger('room0', 1)


def test_the_weak_baseline_sees_the_annotated_points_alone(tmp_path):
    made = AnnotatedLabelMaker(tmp_path / 'labels', PointBudgetSource(ToyRooms(2), '20pts', 0))
    rounds.start(made)
    labels, annotated = made.store.read('room1', 0), made.source.annotated_labels(1)
    np.testing.assert_array_equal(labels.semantic, annotated.semantic)
    np.testing.assert_array_equal(labels.instance, annotated.instance)
    assert labels.confidence.sum() == 20 and not (tmp_path / 'geometry').exists()
    assert made.store.summary(0)['precision'] is None


def test_complete_scenes_keep_their_labels(tmp_path):
    made = label_maker(tmp_path, 'scenes20pct', seed=1)
    rounds.start(made)
    complete, other = sorted(made.index_of, key=lambda name: name not in made.source.budget.complete)
    labels, truth = made.store.read(complete, 0), made.source.truth(made.index_of[complete])
    np.testing.assert_array_equal(labels.semantic, truth.semantic)
    np.testing.assert_array_equal(labels.instance, truth.instance)
    assert labels.complete and made.store.read(other, 0).coverage == 0


def test_seeds_choose_the_geometry_they_are_kept_under(tmp_path):
    kept = {}
    for name, settings in {
        'plain': {'seeds': 'none'},
        'other budget': {'seeds': 'none', 'budget': 'onept'},
        'seeded': {},
        'other seeds': {'seeds': 'annotated', 'seed': 1},
        'seeded again': {'seeds': 'annotated'},
    }.items():
        before = len(list((tmp_path / 'geometry').glob('*.npz')))
        made = label_maker(tmp_path, **settings)
        kept[name] = made.scenes.get('room0').regions.labels
        new = len(list((tmp_path / 'geometry').glob('*.npz'))) - before
        assert new == (name in ('plain', 'seeded', 'other seeds')), name
        seeds = made.seeds('room0')
        assert (seeds is None) == (settings.get('seeds') == 'none')
        if seeds is not None:
            np.testing.assert_array_equal(seeds, np.flatnonzero(made.annotated('room0').semantic >= 0))
    np.testing.assert_array_equal(kept['plain'], kept['other budget'])
    np.testing.assert_array_equal(kept['seeded'], kept['seeded again'])
    with pytest.raises(ValueError, match="SegmentationLabelMaker.seeds: expected one of none, annotated, got 'all'"):
        label_maker(tmp_path, seeds='all')


def test_a_resumed_run_goes_on_with_what_is_there(tmp_path):
    rounds.start(label_maker(tmp_path))
    before = (tmp_path / 'labels' / 'round_000' / 'room0.npz').stat().st_mtime_ns
    again = label_maker(tmp_path)
    rounds.start(again, keep=True)
    assert (tmp_path / 'labels' / 'round_000' / 'room0.npz').stat().st_mtime_ns == before
    with pytest.raises(BudgetError, match='resume with the settings of that run'):
        rounds.start(label_maker(tmp_path, 'onept'), keep=True)
    (tmp_path / 'labels' / 'round_000' / 'complete.json').unlink()  # killed before the round was closed
    rounds.start(again, keep=True)
    assert again.is_finished(0)


def test_points_do_not_name_regions_far_longer_than_their_class_has_elsewhere(tmp_path):
    limited = label_maker(tmp_path, propagation={'max_extent': 0.9})
    lengths = [[] for _ in limited.source.classes]
    for scene in limited.index_of:
        prepared, semantic = limited.scenes.get(scene), limited.annotated(scene).semantic
        for region in range(len(prepared.regions)):
            members = prepared.regions.labels == region
            for c in np.unique(semantic[members & (semantic >= 0)]):
                lengths[c].append(np.sqrt(np.square(prepared.graph.extents[region]).sum()))
    usual = [np.median(own) if len(own) >= 3 else np.nan for own in lengths]
    np.testing.assert_allclose(limited.known.regions.lengths, usual)
    rounds.start(limited)
    free = label_maker(tmp_path / 'free')
    rounds.start(free)
    assert 0.001 < limited.store.summary(0)['coverage'] < free.store.summary(0)['coverage']


def test_labels_spread_by_what_regions_may_be(tmp_path):
    plain = label_maker(tmp_path, 'onept')
    made = label_maker(tmp_path / 'prior', 'onept', region_prior={})
    for one in (plain, made):
        rounds.start(one)
    labelled = 0
    for scene in made.index_of:
        regions, semantic = made.scenes.get(scene).regions.labels, made.annotated(scene).semantic
        for region in np.flatnonzero(np.bincount(regions[regions >= 0]) >= 30):
            classes = np.unique(semantic[(regions == region) & (semantic >= 0)])
            labelled += len(classes) == 1
    assert labelled and len(made.known.regions.known.classes) == labelled
    for scene in made.index_of:
        before, after = plain.store.read(scene, 0), made.store.read(scene, 0)
        known = before.semantic >= 0
        np.testing.assert_array_equal(after.semantic[known], before.semantic[known])
        gained = ~known & (after.semantic >= 0)
        assert not after.point_is_annotated[gained].any() and (after.confidence[gained] >= made.rules.merge.gamma).all()
        assert np.isin(
            after.semantic[gained], made.annotated(scene).semantic
        ).all()  # no class that nobody annotated here
    assert made.store.summary(0)['coverage'] > plain.store.summary(0)['coverage']


def test_later_rounds_read_the_prior_of_the_first_until_the_budget_grows(tmp_path, monkeypatch):
    made = label_maker(tmp_path, 'onept', region_prior={})
    rounds.start(made)
    again = label_maker(tmp_path, 'onept', region_prior={})
    rounds.start(again, keep=True)
    for scene in made.index_of:
        inputs = SceneInputs(made.scenes.get(scene), made.annotated(scene))
        first = made.known.region_prior(inputs, made.rules.region_prior)
        np.testing.assert_allclose(first.sum(axis=1), 1.0)
        np.testing.assert_array_equal(again._prior(1, scene, inputs), first)
        np.testing.assert_array_equal(made.store.read_kept('region_prior', scene)['prior'], first)
    assert 'regions' not in vars(again.known)  # which would read every scene
    monkeypatch.setattr(again, '_class_counts', again.class_counts + 1)
    again._prior(1, 'room0', inputs)
    assert 'regions' in vars(again.known)
    old = {'prior': first, 'class_counts': made.class_counts}
    write_npz(tmp_path / 'labels' / 'kept' / 'region_prior' / 'room0.npz', old)
    with pytest.raises(LabelStoreError, match='room0.npz: has format 1, this version reads 2; train again'):
        again._prior(1, 'room0', inputs)


def test_the_papers_strategy_is_merging_alone(tmp_path):
    ours = {'propagation': {'max_extent': 0.5}, 'region_prior': {'gamma': 0.4}, 'ground': {}}
    ours['self_training'] = {'holdout': 0.25}
    paper = label_maker(tmp_path / 'paper', strategy='paper', merge={'rounds': 2}, **ours)
    alone = label_maker(tmp_path / 'alone', merge={'rounds': 2})
    default = label_maker(tmp_path / 'default', merge={'rounds': 2}, **ours)
    assert paper.rules == SegmentationRules(MergeRules(rounds=2)) == alone.rules
    assert default.rules.merge == MergeRules(rounds=2, gamma=0.4) and default.rules.ground is not None
    for made in (paper, alone, default):
        rounds.start(made)
        made.begin(1)
        for scene, index in made.index_of.items():
            made.refresh(1, scene, certain(made.source.truth(index), 0.6))
        rounds.close(made, 1)
    same = []
    for scene in paper.index_of:
        for number in (0, 1):
            one, two, ours_ = (made.store.read(scene, number) for made in (paper, alone, default))
            np.testing.assert_array_equal(one.semantic, two.semantic)
            np.testing.assert_array_equal(one.instance, two.instance)
            same.append((one.semantic == ours_.semantic).all())
    assert not any(same)
    assert not (tmp_path / 'paper' / 'labels' / 'kept').exists()
    with pytest.raises(ValueError, match='MergeRules.gamma: expected to be left out where RegionPriorRules.gamma=0.4'):
        label_maker(tmp_path, merge={'gamma': 0.8}, **ours)
    with pytest.raises(ValueError, match="strategy: expected one of default, paper, got 'papers'"):
        label_maker(tmp_path, strategy='papers')


class Asking(PointBudgetSource):
    """In round 1 the most uncertain point of each scene is annotated."""

    def __init__(self):
        super().__init__(ToyRooms(2), 'onept')
        self.more = {}

    def extends(self, number):
        return number == 1

    def extend(self, number, scores):
        self.more = {scene: int(np.nanargmax(values)) for scene, values in scores.items()}

    def annotated_labels(self, index):
        shown = super().annotated_labels(index)
        scene = self.scene_ids[index]
        if scene in self.more:
            point, truth = self.more[scene], self.truth(index)
            shown.semantic[point], shown.instance[point] = truth.semantic[point], truth.instance[point]
        return shown

    def point_counts(self):
        return LabelSource.point_counts(self)


def test_a_source_may_show_more_when_it_has_seen_what_is_uncertain(tmp_path):
    made = SegmentationLabelMaker(
        tmp_path / 'labels', Asking(), region_prior={}, cache=tmp_path / 'geometry',
        descriptor={'type': 'AdaptedPFH', 'radius': 0.15, 'max_neighbors': 16},
        oversegmenter={'type': 'RegionGrowing', 'threshold': 0.9, 'max_edge': 0.25, 'min_region': 10}, seeds='none',
    )  # fmt: skip
    rounds.start(made)
    before, first = made.statistics().class_counts, made.store.read_kept('region_prior', 'room0')['prior']
    predictions = {scene: certain(made.source.truth(index)) for scene, index in made.index_of.items()}
    asked = {}
    for scene, prediction in predictions.items():
        truth = made.source.truth(made.index_of[scene]).semantic
        asked[scene] = int(np.flatnonzero((made.annotated(scene).semantic < 0) & (truth >= 0))[7])
        prediction.probabilities[asked[scene]] = 1 / 3
    made.begin(1)
    assert made.source.extends(1) and not made.source.extends(2)
    made.extend_budget(1, predictions.items())
    assert made.source.more == asked
    made.refresh_all(1, predictions.items())
    rounds.close(made, 1)
    assert made.statistics().class_counts.sum() == before.sum() + 2
    for scene, index in made.index_of.items():
        labels, truth = made.store.read(scene, 1), made.source.truth(index)
        assert labels.point_is_annotated[asked[scene]]
        assert labels.semantic[asked[scene]] == truth.semantic[asked[scene]]
    assert not np.array_equal(made.store.read_kept('region_prior', 'room0')['prior'], first, equal_nan=True)


@pytest.mark.parametrize('extent', [None, 0.9])
def test_examples_are_regions_that_are_not_too_long_and_every_scene_is_read_once(tmp_path, monkeypatch, extent):
    propagation = {'max_extent': extent}
    made = label_maker(tmp_path, region_prior={}, propagation=propagation)
    read, prepared = [], made.scenes.get
    monkeypatch.setattr(made.scenes, 'get', lambda scene: read.append(scene) or prepared(scene))
    found = made.known.regions
    assert read == list(made.index_of)
    features, classes = [], []
    for scene in read:
        geometry, semantic = prepared(scene), made.annotated(scene).semantic
        every = prior_features(geometry.cloud, geometry.regions, geometry.graph)
        for region, length in enumerate(np.linalg.norm(geometry.graph.extents, axis=1)):
            members = geometry.regions.labels == region
            own = np.unique(semantic[members & (semantic >= 0)])
            if len(own) == 1 and members.sum() >= 30 and not (extent and length > extent * found.lengths[own[0]]):
                features.append(every[region])
                classes.append(own[0])
    assert found.known.classes.tolist() == classes
    expected = (np.array(features) - found.known.middle) * found.known.scale
    np.testing.assert_array_equal(found.known.features, expected)
    if extent:
        free = label_maker(tmp_path, region_prior={}).known.regions
        np.testing.assert_array_equal(free.lengths, found.lengths)
        assert 0 < len(classes) < len(free.known.classes)


def test_the_ground_is_named_by_a_classifier_once(tmp_path, monkeypatch):
    kernel = {'min_upright': 0.9, 'classifier': 'kernel'}
    made = label_maker(tmp_path, ground=kernel)
    assert made.known.ground is None  # too few annotated ground points; the nearest names each, as without
    plain = label_maker(tmp_path / 'plain', ground={'min_upright': 0.9})
    for one in (made, plain):
        rounds.start(one)
    assert plain.known.ground is None
    for scene in made.index_of:
        assert made.store.read(scene, 0).semantic.tolist() == plain.store.read(scene, 0).semantic.tolist()

    monkeypatch.setattr(ground_classifier, 'LEAST_EXAMPLES', 3)
    made = label_maker(tmp_path / 'kernel', ground=kernel)
    rounds.start(made)
    made.begin(1)
    for scene in made.index_of:
        prepared, annotated, labels = made.scenes.get(scene), made.annotated(scene), made.store.read(scene, 0)
        ground = np.append(np.abs(prepared.graph.normals[:, 2]) >= 0.9, False)[prepared.regions.labels]
        named = made.known.ground.labels(prepared.cloud, ground, annotated.semantic, 3)
        hidden = ground & (annotated.semantic < 0)
        assert hidden.any() and labels.semantic[hidden].tolist() == named.classes[hidden].tolist()
        np.testing.assert_allclose(labels.confidence[hidden], named.confidence[hidden], rtol=1e-6)
        rows = np.random.default_rng(0).dirichlet(np.ones(3), len(ground)).astype(np.float32)
        made.refresh(1, scene, PointPrediction(rows, None))
        assert made.store.read(scene, 1).semantic[ground].tolist() == labels.semantic[ground].tolist()


# ---------------------------------------------------------------------- points kept aside


def test_points_kept_aside_reach_neither_labels_nor_counts_nor_seeds(tmp_path):
    whole, made = label_maker(tmp_path, '1pct'), label_maker(tmp_path / 'held', '1pct', self_training={'holdout': 0.25})
    rounds.start(made)
    kept = 0
    for scene in made.index_of:
        held, all_known = made.holdout(scene), whole.annotated(scene)
        assert len(held.points) >= 4
        np.testing.assert_array_equal(held.classes, all_known.semantic[held.points])
        assert (made.annotated(scene).semantic[held.points] == -1).all()
        assert not np.isin(held.points, made.seeds(scene)).any()
        assert not made.store.read(scene, 0).point_is_annotated[held.points].any()
        kept += np.bincount(held.classes, minlength=3)
    np.testing.assert_array_equal(made.class_counts + kept, whole.class_counts)
    again = label_maker(tmp_path / 'held', '1pct', self_training={'holdout': 0.25})
    np.testing.assert_array_equal(again.holdout('room1').points, made.holdout('room1').points)


@pytest.mark.parametrize('holdout', [0.0, 0.25])
def test_a_bad_round_is_taken_back_by_the_points_kept_aside(tmp_path, holdout):
    """The planted network calls everything a box, surely; where points are kept aside, no such label stays."""
    told = []
    made = label_maker(tmp_path, '1pct', merge={'demote_margin': 0.15, 'rounds': 2}, self_training={'holdout': holdout})
    rounds.start(made)
    made.begin(1)
    first = {scene: made.store.read(scene, 0) for scene in made.index_of}
    for scene, index in made.index_of.items():
        truth = made.source.truth(index)
        wrong = certain(truth)
        wrong.probabilities[:] = [0.02, 0.96, 0.02]
        made.refresh(1, scene, wrong)
    planted = sum(int((made.store.read(s, 1).semantic == 1).sum()) for s in made.index_of)
    rounds.close(made, 1, told.append)
    assert planted > 1.2 * sum(int((labels.semantic == 1).sum()) for labels in first.values())
    for scene, before in first.items():
        after = made.store.read(scene, 1)
        new = (after.semantic == 1) & (before.semantic != 1) & ~after.point_is_annotated
        assert new.any() == (holdout == 0)
    assert len(told) == 1 + (holdout > 0)
    if holdout:
        assert 'labels of round 1: the holdout contradicts box (' in told[0]
        assert made.store.read_ledger('room0', 1)
    assert made.store.is_complete(1)


def test_a_good_round_stays(tmp_path):
    told = []
    made = label_maker(tmp_path, '1pct', self_training={'holdout': 0.25})
    rounds.start(made)
    made.begin(1)
    for scene, index in made.index_of.items():
        made.refresh(1, scene, certain(made.source.truth(index)))
    rounds.close(made, 1, told.append)
    assert len(told) == 1 and made.store.summary(1)['coverage'] > made.store.summary(0)['coverage']


# ---------------------------------------------------------------------- the report


def labels(semantic, instance, is_annotated):
    semantic = np.array(semantic)
    return PseudoLabels(
        semantic=semantic,
        instance=np.array(instance),
        point_is_annotated=np.array(is_annotated, dtype=bool),
        confidence=(semantic >= 0).astype(np.float32),
        boxes=Boxes3D.empty(),
        box_is_annotated=np.zeros(0, dtype=bool),
    )


XYZ = np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0], [6, 0, 0], [0, 9, 0], [0, 9, 0]], dtype=np.float32)
TRUTH = SceneTruth(np.array([1, 1, 1, 1, 0, -1]), np.array([0, 0, 0, 0, -1, -1]), XYZ)


def test_a_round_added_up_by_hand():
    scene = labels([1, 1, 0, -1, 0, 0], [2, 2, -1, -1, -1, -1], [1, 0, 0, 0, 0, 0])
    summary = summarise_points(iter([(scene, TRUTH), (labels([0], [-1], [0]), None)]), ('floor', 'box'))
    assert summary['coverage'] == pytest.approx(6 / 7)
    assert summary['precision'] == pytest.approx(2 / 3)  # of points 1, 2, 4; the first is annotated, the last unknown
    assert summary['mean_precision'] == pytest.approx((1 / 2 + 1) / 2)
    assert summary['offset_error'] == pytest.approx(2.0)  # centre at x = 1 instead of 3
    assert summary['points']['floor'] == {
        'pseudo': 4,
        'precision': 0.5,
        'recall': 1.0,
        'coverage': 1.0,
        'offset_error': None,
    }
    assert summary['points']['box'] == {
        'pseudo': 1,
        'precision': 1.0,
        'recall': pytest.approx(1 / 3),
        'coverage': pytest.approx(2 / 3),
        'offset_error': pytest.approx(2.0),
    }
    assert summary['boxes'] == {} and summary['truth_known']
    line = describe_round(summary)
    assert line.startswith('coverage 85.7 %, precision 66.7 %, offset error 2.00 m; floor 4 points (50 % correct)')


def test_without_truth_or_scenes():
    scene = labels([1, -1], [0, -1], [1, 0])
    summary = summarise_points([(scene, None)], ('floor', 'box'))
    assert summary['coverage'] == 0.5 and not summary['truth_known']
    assert summary['precision'] is summary['mean_precision'] is summary['offset_error'] is None
    assert summarise_points([], ('floor',))['coverage'] == 0.0
    assert describe_round(summary).startswith('coverage 50.0 %; floor 0 points; box 0 points')


def test_the_toy_scene_is_what_it_says():
    scene = make_scene(0)
    assert (scene.semantic == -1).sum() == 40 and set(np.unique(scene.instance)) == {-1, 0, 1, 2}
