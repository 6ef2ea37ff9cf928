from types import SimpleNamespace

import numpy as np
import pytest
import torch
from mmengine.evaluator import Evaluator

from rm3d_plugin.datasets.kitti_format import (
    KittiCalib,
    KittiObject,
    boxes_to_objects,
    objects_to_boxes,
    read_objects,
)
from rm3d_plugin.evaluation.kitti_metric import KittiMetric, truth_from_objects
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import Boxes3D, SceneError, SceneSample

CLASSES = ('Car', 'Pedestrian', 'Cyclist')
CALIB = KittiCalib(
    P2=np.array([[720.0, 0, 610, 45], [0, 720, 173, 0.2], [0, 0, 1, 0.003]]),
    R0_rect=np.eye(3),
    Tr_velo_to_cam=np.array([[0.0, -1, 0, 0], [0, 0, -1, -0.08], [1, 0, 0, -0.27]]),
)
BOXES = Boxes3D(
    np.array(
        [[12.0, 2, -0.9, 4, 1.7, 1.5, 0.3], [10, -3, -0.8, 0.8, 0.6, 1.8, -1.2], [18, -2, -0.9, 4.2, 1.7, 1.6, 3.0]]
    ),
    np.array([0, 1, 0]),
    np.array([0.9, 0.8, 0.7]),
)
DONT_CARE = KittiObject('DontCare', -1, -1, -10, (600.0, 170, 650, 200), -1, -1, -1, -1000, -1000, -1000, -10)


def truth_of(boxes):
    lines = boxes_to_objects(boxes, CALIB, CLASSES)
    return [KittiObject(**{**vars(o), 'truncated': 0.0, 'occluded': 0, 'score': None}) for o in lines]


def sample(truth, found, scene_id='000007', **meta):
    annotation = SimpleNamespace(objects=tuple(truth), calib=CALIB, image_size=(1242, 375))
    out = SceneSample(metainfo={'scene_id': scene_id, **(meta or {'annotation': annotation})})
    out.pred_bboxes_3d = torch.as_tensor(found.tensor, dtype=torch.float32)
    out.pred_labels_3d = torch.as_tensor(found.labels)
    out.pred_scores_3d = torch.as_tensor(found.scores, dtype=torch.float32)
    return out


def run(samples, **options):
    evaluator = Evaluator([METRICS.build({'type': 'KittiMetric', **options})])
    evaluator.dataset_meta = {'classes': CLASSES}
    evaluator.process(samples, None)
    return evaluator.evaluate(len(samples))


def test_perfect_predictions_reach_100_through_mmengine():
    got = run([sample([*truth_of(BOXES), DONT_CARE], BOXES)])
    for metric in ('bbox', 'aos', 'bev', '3d'):
        assert got[f'Car_{metric}_easy_R40@0.70'] == pytest.approx(100, abs=1e-6)
        assert got[f'mAP_{metric}_moderate_R40'] == pytest.approx(100, abs=1e-6)
        assert got[f'mAP_{metric}_hard_R11_loose'] == pytest.approx(100, abs=1e-6)
    assert got['Car_3d_easy_R40@0.50'] == pytest.approx(100)
    assert got['Pedestrian_3d_easy_R40@0.25'] == pytest.approx(100)
    assert not any(key.startswith('Cyclist') for key in got)


def test_one_of_two_cars_and_no_pedestrian():
    got = run([sample(truth_of(BOXES), BOXES.select(np.array([0])))])
    assert got['Car_3d_moderate_R40@0.70'] == pytest.approx(50)
    assert got['Pedestrian_3d_moderate_R40@0.50'] == 0
    assert got['mAP_3d_moderate_R40'] == pytest.approx(25)


def test_frames_add_up_and_empty_predictions_are_fine():
    car = BOXES.select(np.array([0]))
    got = run([sample(truth_of(car), car, '0'), sample(truth_of(car), Boxes3D.empty(), '1')])
    assert got['Car_3d_moderate_R40@0.70'] == pytest.approx(50)


def test_boxes_behind_the_camera_are_no_detections():
    behind = Boxes3D(np.array([[-12.0, 2, -0.9, 4, 1.7, 1.5, 0.3]]), np.array([0]), np.array([0.99]))
    both = Boxes3D(np.r_[behind.tensor, BOXES.tensor], np.r_[0, BOXES.labels], np.r_[0.99, BOXES.scores])
    assert run([sample(truth_of(BOXES), both)])['Car_3d_moderate_R40@0.70'] == pytest.approx(100)


def test_truth_boxes_keep_their_rows():
    truth = truth_of(BOXES)
    got = truth_from_objects([truth[0], DONT_CARE, truth[1]], CALIB)
    np.testing.assert_allclose(got.boxes3d[[0, 2]], BOXES.tensor[:2], atol=1e-9)
    assert (got.boxes3d[1] == 0).all()
    assert list(got.types) == ['Car', 'DontCare', 'Pedestrian']


def test_objects_as_dicts_are_accepted():
    objects = [vars(o) for o in truth_of(BOXES)]
    got = run([sample(None or [], BOXES, kitti_objects=objects, calib=CALIB)])
    assert got['mAP_3d_moderate_R40'] == pytest.approx(100, abs=1e-6)


def test_export_reads_back(tmp_path):
    run([sample(truth_of(BOXES), BOXES)], export_dir=str(tmp_path / 'txt'), prefix='kitti')
    lines = read_objects(tmp_path / 'txt' / '000007.txt')
    back = objects_to_boxes(lines, CALIB, CLASSES)
    np.testing.assert_allclose(back.tensor, BOXES.tensor, atol=0.011)
    np.testing.assert_allclose(back.scores, BOXES.scores, atol=1e-4)


def test_prefix_and_one_set_of_thresholds():
    got = run([sample(truth_of(BOXES), BOXES)], prefix='kitti', loose_iou_thresholds=None, metrics=('3d',))
    assert 'kitti/mAP_3d_moderate_R40' in got
    assert not any('loose' in key or '_bev_' in key or '@0.50' in key and 'Car' in key for key in got)


def test_errors_say_what_to_do():
    with pytest.raises(SceneError, match="scene 000007: the sample carries no KITTI annotation; .*labels='truth'"):
        run([sample([], BOXES, num_points=3)])
    broken = sample(truth_of(BOXES), BOXES)
    broken.pred_bboxes_3d = broken.pred_bboxes_3d * torch.nan
    with pytest.raises(SceneError, match='scene 000007: predicted boxes cannot be used'):
        run([broken])
    bare = sample(truth_of(BOXES), BOXES)
    del bare.pred_scores_3d
    with pytest.raises(SceneError, match="no 'pred_scores_3d'"):
        run([bare])
    with pytest.raises(ValueError, match='no classes'):
        KittiMetric().class_names  # noqa: B018
