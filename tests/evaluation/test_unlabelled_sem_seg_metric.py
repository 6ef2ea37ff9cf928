"""Annotated points do not count."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from rm3d_plugin.evaluation import SemSegMetric, UnlabelledSemSegMetric
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import Boxes3D, PseudoLabels, SceneSample


@pytest.fixture
def store(tmp_path):
    """Labels of a scene of six points, of which the first two are annotated."""
    labels = LabelStore(tmp_path)
    labels.begin_round(0)
    semantic, annotated = np.array([0, 1, 0, -1, -1, 1]), np.array([1, 1, 0, 0, 0, 0], dtype=bool)
    scene = PseudoLabels(
        semantic=semantic,
        instance=np.full(6, -1),
        point_is_annotated=annotated,
        confidence=np.where(semantic >= 0, 1, 0).astype(np.float32),
        boxes=Boxes3D.empty(),
        box_is_annotated=np.zeros(0, dtype=bool),
        complete=False,
    )
    labels.write(0, 'a', scene, None)
    labels.finish_round(0, {})
    labels.set_current(0)
    return tmp_path


def sample():
    made = SceneSample(metainfo={'scene_id': 'a', 'num_points': 6})
    made.pred_point_probs = torch.eye(2)[torch.tensor([1, 0, 0, 0, 1, 1])]  # both annotated points wrong
    made.pts_semantic_mask = torch.tensor([0, 1, 0, 0, 1, 0])
    return made


def scored(metric):
    metric.process(None, [sample()])
    return metric.evaluate(1)


def test_only_hidden_points_count(store):
    got = scored(UnlabelledSemSegMetric(store, classes=('road', 'car')))
    assert got['IoU_road'] == pytest.approx(100 * 2 / 3)  # points 2, 3 right, 5 taken for a car
    assert got['IoU_car'] == pytest.approx(50.0)
    assert got['accuracy'] == pytest.approx(75.0)
    assert scored(SemSegMetric(classes=('road', 'car')))['accuracy'] == pytest.approx(50.0)


def test_labels_of_the_round_come_before_the_network(store):
    got = scored(UnlabelledSemSegMetric(store, keep_labels=True, classes=('road', 'car')))
    assert got['accuracy'] == pytest.approx(75.0)  # point 5 is labelled a car, as the network says; the truth is road
    made = sample()
    made.pred_point_probs[2] = torch.tensor([0.0, 1.0])  # what is labelled needs no network
    metric = UnlabelledSemSegMetric(store, keep_labels=True, classes=('road', 'car'))
    metric.process(None, [made])
    assert metric.evaluate(1) == got


def test_what_labels_find_likeliest_comes_before_the_network(store):
    labels = LabelStore(store)
    labels.begin_round(1)
    labels.write(1, 'a', replace(labels.read('a'), likeliest=np.array([1, 1, 1, 1, -1, 0])), None)
    labels.finish_round(1, {})
    labels.set_current(1)
    got = scored(UnlabelledSemSegMetric(store, keep_labels=True, classes=('road', 'car')))
    # 2 and 5 have labels, 3 is likeliest a car, 4 is the network's: a car
    assert got['accuracy'] == pytest.approx(50.0)
