"""What a network says of the training points, noted by round: by hand, and in a real run, which it leaves as it is."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from baselines.test_fairness import TINY, geometry, train, world  # noqa: F401  fixtures

from rm3d_plugin.baselines import ERDA
from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.hooks import PredictionQualityHook, RegionMergeHook
from rm3d_plugin.pseudo_labels import AnnotatedLabels, PointPrediction
from rm3d_plugin.storage import read_json
from rm3d_plugin.structures import Boxes3D, PointCloud

XYZ = np.array([[9, 9, 9], [0, 0, 0], [2, 0, 0], [5, 5, 5], [7, 7, 7]], dtype=np.float32)
TRUTH = Truth(Boxes3D.empty(), np.array([0, 1, 1, 0, -1]), np.array([-1, 0, 0, -1, -1]))
SHOWN = AnnotatedLabels(np.array([0, -1, -1, -1, -1]), np.full(5, -1), Boxes3D.empty())
SAID = PointPrediction(  # known; right; wrong; not sure; nobody knows the truth
    np.array([[0.0, 1.0], [0.05, 0.95], [0.95, 0.05], [0.6, 0.4], [1.0, 0.0]]),
    np.array([[0, 0, 0], [1, 0, 0], [1, 0, 3], [0, 0, 0], [0, 0, 0]], dtype=np.float64),
)


@pytest.fixture
def runner(tmp_path, monkeypatch):
    source = SimpleNamespace(
        classes=('floor', 'box'),
        truth=lambda index: TRUTH,
        annotated_labels=lambda index: SHOWN,
        load_cloud=lambda index: PointCloud(XYZ),
    )
    maker = SimpleNamespace(task='segmentation', source=source, index_of={'a': 0}, checked=lambda found: found)
    merging = RegionMergeHook(interval=2, label_maker=maker, dataloader=[])
    monkeypatch.setattr(merging, 'predictions', lambda model, why: iter([('a', SAID)]))
    return SimpleNamespace(hooks=[merging], model=None, epoch=0, work_dir=str(tmp_path))


def test_a_round_by_hand(runner, tmp_path):
    hook = PredictionQualityHook(threshold=0.9)
    hook.before_train(runner)
    for runner.epoch in range(5):
        hook.after_train_epoch(runner)
    told = {'coverage': 0.8, 'precision': 0.5, 'offset_error': 1.5}  # four of five; one of two; of 0 and 3 m
    assert read_json(tmp_path / 'predicted_labels.json') == {'0': told, '1': told}


def test_a_resumed_run_goes_on_and_a_new_one_begins_anew(runner, tmp_path):
    (tmp_path / 'predicted_labels.json').write_text('{"0": {"coverage": 0.1}}')
    runner.epoch = 3
    resumed, new = PredictionQualityHook(), PredictionQualityHook()
    resumed.before_train(runner)
    resumed.after_train_epoch(runner)
    assert list(read_json(tmp_path / 'predicted_labels.json')) == ['0', '1']
    runner.epoch = 0
    new.before_train(runner)
    runner.epoch = 1
    new.after_train_epoch(runner)
    assert read_json(tmp_path / 'predicted_labels.json')['0']['coverage'] == 0.8


def test_it_needs_rounds(runner):
    runner.hooks, runner.epoch = [], 1
    with pytest.raises(ConfigError, match='expected a RegionMergeHook of segmentation'):
        PredictionQualityHook().after_train_epoch(runner)


def test_training_sees_nothing_of_it(tmp_path, geometry, world):  # noqa: F811
    losses, state, _ = train(ERDA, tmp_path / 'alone', geometry)
    world.setitem(TINY, 'method_hook', {'type': 'PredictionQualityHook', 'threshold': 0.4})
    seen_losses, seen_state, _ = train(ERDA, tmp_path / 'seen', geometry)
    assert losses == seen_losses and all(torch.equal(state[name], seen_state[name]) for name in state)
    told = read_json(tmp_path / 'seen' / 'predicted_labels.json')
    assert list(told) == ['0', '1'] and 0 < told['1']['coverage'] <= 1 and 0 <= told['1']['precision'] <= 1
