"""Self-training in rounds: what the network is sure of becomes a label, and annotated labels always win."""

from types import SimpleNamespace

import numpy as np
from labeling import rounds
from reference.toy_scenes import ToyRooms

from rm3d_plugin.labeling import ConfidentPoints, ConfidentRegions, PointBudgetSource, PredictedLabelMaker
from rm3d_plugin.labeling.accept import region_means
from rm3d_plugin.labeling.predicted import spread_over_regions
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.structures import Regions

NAN = float('nan')
SAID = np.array([[0.9, 0.1], [0.3, 0.7], [NAN, NAN], [0.4, 0.6]])
NONE = np.full(4, -1)


def test_points_above_the_threshold():
    found = ConfidentPoints(0.7)(PointPrediction(SAID), NONE, lambda: None)
    assert found.semantic.tolist() == [0, 1, -1, -1]
    np.testing.assert_allclose(found.confidence, [0.9, 0.7, 0, 0], rtol=1e-6)


def test_regions_by_their_mean():
    regions = Regions(np.array([0, 0, 0, 1]))
    scene = SimpleNamespace(regions=regions)
    np.testing.assert_allclose(region_means(SAID, regions), [[0.6, 0.4], [0.4, 0.6]])
    found = ConfidentRegions(0.6)(PointPrediction(SAID), NONE, lambda: scene)
    assert found.semantic.tolist() == [0, 0, 0, 1]  # the point that the network did not see, too
    assert ConfidentRegions(0.61)(PointPrediction(SAID), NONE, lambda: scene).semantic.tolist() == [-1] * 4


def test_an_annotated_point_labels_its_region():
    regions = Regions(np.array([0, 0, 1, 1, 1, -1, 2]))
    semantic = np.array([4, -1, 2, 3, 3, 1, -1])
    assert spread_over_regions(semantic, regions).tolist() == [4, 4, 3, 3, 3, -1, -1]


def label_maker(tmp_path, **settings):
    source = PointBudgetSource(ToyRooms(1), '20pts', 0)
    made = PredictedLabelMaker(tmp_path / 'labels', source, {'type': 'ConfidentPoints', 'threshold': 0.7}, **settings)
    rounds.start(made)
    return made


def told(made, number, best, sure):
    """Run a round in which the network says one class of the first 500 points."""
    shares = np.full((len(made.source.load_cloud(0).xyz), 3), 1 / 3)
    shares[:500] = (1 - sure) / 2
    shares[:500, best] = sure
    made.begin(number)
    made.refresh_all(number, [('room0', PointPrediction(shares))])
    rounds.close(made, number, rounds.quiet)
    return made.store.read('room0', number)


def test_annotated_labels_win_and_later_rounds_choose_anew(tmp_path):
    made = label_maker(tmp_path)
    first = made.store.read('room0', 0)
    known = first.semantic >= 0
    assert known.sum() == 20 and first.point_is_annotated.sum() == 20
    labels = told(made, 1, best=2, sure=0.8)
    np.testing.assert_array_equal(labels.semantic[known], first.semantic[known])
    free = ~known
    assert (labels.semantic[:500][free[:500]] == 2).all() and (labels.semantic[500:][free[500:]] == -1).all()
    assert labels.confidence[:500][free[:500]].tolist() == [np.float32(0.8)] * free[:500].sum()
    assert (told(made, 2, best=1, sure=0.9).semantic[:500][free[:500]] == 1).all()


def test_permanent_labels_stay(tmp_path):
    made = label_maker(tmp_path, permanent=True)
    before = told(made, 1, best=2, sure=0.8)
    after = told(made, 2, best=1, sure=0.9)
    np.testing.assert_array_equal(before.semantic, after.semantic)
    assert made.store.summary(2)['coverage'] > 0.2
