"""What detectors of streets do that those of rooms do not."""

from types import SimpleNamespace

import numpy as np
import pytest

from rm3d_plugin.engine.config import load_config
from rm3d_plugin.labeling import detection
from rm3d_plugin.labeling.detection import DetectionLabelMaker, _as_asked
from rm3d_plugin.pseudo_labels import detection_rules
from rm3d_plugin.registry import MODELS


@pytest.mark.parametrize(
    ('leaf', 'streets'),
    [('rm3d_votenet_kitti_1pct', True), ('rm3d_votenet_waymo_1pct', True), ('rm3d_votenet_scannet_1pct', False)],
)
def test_boxes_of_streets_stand_on_the_ground_and_ask_the_points(leaf, streets):
    config = load_config(leaf)
    model = MODELS.build(config.model)
    assert (model.on_ground, model.score_by_points, model.score_by_height) == (streets, streets, streets)
    rules = detection_rules(teacher=config.teacher)
    assert (rules.teacher is not None) == streets
    if streets:
        teacher = rules.teacher
        assert (teacher.top, teacher.seen_height, teacher.share) == (0.95, 0.85, 0.7)
        assert (teacher.least_likeness, teacher.usual_likeness) == (0.1, 0.5)
    usual = detection_rules(teacher=config.predicted_boxes).teacher
    hook = next(hook for hook in config.custom_hooks if hook and hook['type'] == 'RegionMergeHook')
    told = hook['label_maker'].get('cluster_descriptor')
    assert told == ({'type': 'Semantic'} if streets else None)
    assert usual.share == 0.7 and (usual.top > 0) == (usual.least_likeness > 0) == streets


@pytest.mark.parametrize(
    ('options', 'round_in_use', 'judged'),
    [
        ({}, None, True),  # looks tell from the start what is background
        ({}, 0, True),
        ({}, 1, True),
        ({'predicted_boxes.least_likeness': 0.0}, None, False),
        ({'predicted_boxes.least_likeness': 0.0}, 0, False),
        ({'predicted_boxes.least_likeness': 0.0}, 1, True),
        ({'predicted_boxes.ignore_unknown': False}, 1, False),
        ({'teacher': None}, 1, False),
    ],
)
def test_labels_judged_every_place_once_shapes_or_predicted_boxes_made_them(options, round_in_use, judged):
    config = load_config('rm3d_votenet_kitti_1pct', options=options)
    rules = detection_rules(teacher=config.teacher)
    sizes = np.ones((3, 3))
    maker = SimpleNamespace(
        rules=rules,
        store=SimpleNamespace(current_round=lambda: round_in_use),
        class_counts=np.ones(3, int),
        mean_sizes=sizes,
        _looks_tell=lambda: rules.teacher is not None and rules.teacher.least_likeness > 0,
    )
    told = DetectionLabelMaker.statistics(maker)
    assert told.judged == judged and told.mean_sizes is sizes
    maker._looks_tell = lambda: False  # of some class nobody knows what its objects look like
    assert DetectionLabelMaker.statistics(maker).judged == (judged and bool(round_in_use))


def test_looks_are_not_asked_where_the_first_labels_stay():
    for leaf, asked in (('rm3d_votenet_kitti_1pct', 0.1), ('sup_votenet_kitti_1pct', 0.0)):
        config = load_config(leaf)
        rules = detection_rules(merge=config['merge'], teacher=config.teacher)
        assert rules.teacher.least_likeness == 0.1 and _as_asked(rules).teacher.least_likeness == asked
    assert _as_asked(detection_rules(merge={'rounds': 1})).teacher is None


def test_clusters_are_described_by_the_descriptor_of_the_config(monkeypatch):
    given = []
    monkeypatch.setattr(detection, 'ClusterKnowledge', lambda *asked: given.append(asked) or 'told')
    maker = SimpleNamespace(
        index_of={'s': 0},
        scenes=None,
        annotated=None,
        mean_sizes=None,
        _clusters=None,
        _cluster_descriptor={'type': 'any'},
    )
    assert DetectionLabelMaker._cluster_knowledge(maker) == DetectionLabelMaker._cluster_knowledge(maker) == 'told'
    assert given == [(['s'], None, None, None, {'type': 'any'})]
