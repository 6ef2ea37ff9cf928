import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from labeling import rounds
from reference.toy_scenes import ToyRooms

from rm3d_plugin.baselines.otoc import propagation
from rm3d_plugin.baselines.otoc.accept import PropagatedRegions
from rm3d_plugin.baselines.otoc.propagation import mean_field
from rm3d_plugin.baselines.otoc.relation import PrototypeRelation, prototype_contrast
from rm3d_plugin.labeling import PointBudgetSource, PredictedLabelMaker
from rm3d_plugin.models import Batch
from rm3d_plugin.pseudo_labels import PointPrediction
from rm3d_plugin.structures import Regions


def slow_mean_field(unary, features, known, steps):
    said = [list(row) for row in unary]
    for region, kind in enumerate(known):
        if kind >= 0:
            said[region] = [float(kind == c) for c in range(len(unary[0]))]
    for _ in range(steps):
        after = []
        for i, row in enumerate(unary):
            if known[i] >= 0:
                after.append(said[i])
                continue
            score = list(np.log(row))
            for j in range(len(unary)):
                kernel = math.exp(-0.5 * sum((a - b) ** 2 for a, b in zip(features[i], features[j], strict=True)))
                score = [s + kernel * q * (j != i) for s, q in zip(score, said[j], strict=True)]
            total = sum(math.exp(s) for s in score)
            after.append([math.exp(s) / total for s in score])
        said = after
    return np.array(said)


@pytest.mark.parametrize('block', [3, 100])
def test_it_is_the_slow_one(monkeypatch, block):
    monkeypatch.setattr(propagation, '_BLOCK', block)
    rng = np.random.default_rng(0)
    unary, features = rng.dirichlet(np.ones(3), size=7), rng.normal(size=(7, 4))
    known = np.array([-1, 2, -1, -1, 0, -1, -1])
    found = mean_field(unary, features, known, steps=3)
    np.testing.assert_allclose(found, slow_mean_field(unary.tolist(), features.tolist(), known.tolist(), 3), atol=1e-9)


def test_a_class_travels_to_regions_that_are_alike():
    regions = Regions(np.array([0, 0, 1, 1, 2, 2, -1]))
    scene = SimpleNamespace(
        regions=regions,
        graph=SimpleNamespace(centroids=np.array([[0.0, 0, 0], [0.5, 0, 0], [0.6, 0, 0]])),
        cloud=SimpleNamespace(colors=np.zeros((7, 3))),
    )
    probs = np.array([[0.5, 0.5]] * 2 + [[0.6, 0.4]] * 2 + [[0.6, 0.4]] * 2 + [[1.0, 0.0]])
    features = np.array([[1.0, 0.0]] * 2 + [[2.0, 0.0]] * 2 + [[0.0, 3.0]] * 2 + [[0.0, 1.0]])
    annotated = np.array([1, -1, -1, -1, -1, -1, -1])
    rule = PropagatedRegions(threshold=0.61)
    found = rule(PointPrediction(probs, features=features), annotated, lambda: scene)
    heard = 0.4 * math.exp(math.exp(-0.125))  # of region 1, from region 0
    assert heard / (heard + 0.6) > 0.61 and rule.reads_features
    assert found.semantic.tolist() == [1, 1, 1, 1, -1, -1, -1]
    assert found.confidence[2] == pytest.approx(heard / (heard + 0.6), rel=1e-5)
    with pytest.raises(ValueError, match='pred_point_features'):
        rule(PointPrediction(probs), annotated, lambda: scene)


def test_contrast_by_hand():
    similarity = torch.tensor([[1.0, 0.5, -torch.inf], [0.2, 0.4, -torch.inf]])
    wanted = (math.log(1 + math.exp(-1.0)) + math.log(1 + math.exp(0.4))) / 2
    assert prototype_contrast(similarity, torch.tensor([0, 0]), 0.5).item() == pytest.approx(wanted, rel=1e-5)
    assert prototype_contrast(similarity[:0], torch.zeros(0, dtype=torch.int64)).item() == 0.0


def test_labelled_points_draw_near_to_their_prototype():
    features = torch.tensor([[2.0, 0.0], [1.0, 1.0], [0.0, 3.0]], requires_grad=True)
    labels = SimpleNamespace(semantic=torch.tensor([0, -1, 2]))
    term = PrototypeRelation(num_classes=3, channels=2, temperature=1.0)
    batch = Batch(torch.zeros(3, 3), torch.tensor([0, 3]))
    loss = term(batch, SimpleNamespace(features=features), labels)['loss_relation']
    assert torch.allclose(term.bank.values[:, 0], torch.tensor([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]))
    assert loss.item() == pytest.approx(math.log(1 + math.exp(-1.0)), rel=1e-5)
    loss.backward()
    assert features.grad[1].abs().sum() == 0


def test_rounds_of_a_run(tmp_path):
    source = PointBudgetSource(ToyRooms(1), 'onept_instance', 0)
    made = PredictedLabelMaker(
        tmp_path / 'labels', source, {'type': 'PropagatedRegions'}, permanent=True, spread=True,
        cache=tmp_path / 'geometry',
        descriptor={'type': 'AdaptedPFH', 'radius': 0.15, 'max_neighbors': 16},
        oversegmenter={'type': 'RegionGrowing', 'threshold': 0.9, 'max_edge': 0.25, 'min_region': 10},
    )  # fmt: skip
    assert made.reads_features
    first, truth = rounds.start(made).store.read('room0', 0), source.truth(0).semantic
    wide = first.semantic >= 0
    assert first.point_is_annotated.sum() == 5 and wide.sum() > 200  # five clicks, each for its region
    assert (first.semantic == truth)[wide & (truth >= 0)].mean() > 0.95
    features = np.eye(3)[np.maximum(truth, 0)] + 0.01  # a network that sees classes, but cannot name them
    made.begin(1)
    made.refresh_all(1, [('room0', PointPrediction(np.full((len(truth), 3), 1 / 3), features=features))])
    rounds.close(made, 1)
    second = made.store.read('room0', 1)
    np.testing.assert_array_equal(second.semantic[wide], first.semantic[wide])
    new = (second.semantic >= 0) & ~wide & (truth >= 0)
    assert new.sum() > 100 and (second.semantic == truth)[new].mean() > 0.95
