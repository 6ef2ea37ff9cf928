from types import SimpleNamespace

import numpy as np
import pytest
import torch
from mmengine.evaluator import Evaluator

from rm3d_plugin.datasets.kitti_format import (
    KittiCalib,
    KittiObject,
    boxes_to_objects,
    format_object,
    objects_to_boxes,
    read_calib,
    read_objects,
)
from rm3d_plugin.evaluation.functional import OFFICIAL_IOU
from rm3d_plugin.evaluation.kitti_metric import KittiMetric, truth_from_objects
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import Boxes3D, SceneError, SceneSample
from tests.reference import kitti_ap_slow as slow

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
    evaluator = Evaluator([METRICS.build({'type': 'KittiMetric', 'sampling': 'auto', **options})])
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


def turn(axis, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    first, second = [i for i in range(3) if i != axis]
    out = np.eye(3)
    out[[first, first, second, second], [first, second, first, second]] = c, -s, s, c
    return out


TILTED = KittiCalib(  # the camera looks down by 5 degrees and leans by 4
    P2=CALIB.P2,
    R0_rect=turn(0, -5) @ turn(2, 1),
    Tr_velo_to_cam=np.c_[turn(2, 3) @ CALIB.Tr_velo_to_cam[:, :3], CALIB.Tr_velo_to_cam[:, 3]],
)


def near_misses(objects, calib, rng):
    """Boxes about the objects, most of them near hits, and some of no object."""
    kept = [o for o in objects if o.type in CLASSES]
    boxes = objects_to_boxes(kept, calib, CLASSES)
    rows = np.repeat(np.arange(len(kept)), 3)
    tensor = boxes.tensor[rows] + rng.normal(0, 0.06, (len(rows), 7)) * [2, 1, 1, 1, 0.5, 1, 1]
    labels = np.where(rng.uniform(size=len(rows)) < 0.9, boxes.labels[rows], 0)
    return Boxes3D(
        np.abs(tensor) * np.where(np.arange(7) == 6, 1, np.sign(tensor)), labels, rng.uniform(size=len(rows))
    )


def worlds(rng, frames=25):
    """Frames of labels as a file has them, seen by the tilted camera."""
    for number in range(frames):
        boxes = np.c_[rng.uniform(8, 45, 6), rng.uniform(-6, 6, 6), rng.uniform(-1.2, -0.6, 6)]
        sizes = np.tile([[4.0, 1.7, 1.5], [0.8, 0.6, 1.8], [1.8, 0.6, 1.7]], (2, 1)) * rng.uniform(0.9, 1.1, (6, 3))
        found = Boxes3D(np.c_[boxes, sizes, rng.uniform(-3, 3, 6)], np.tile([0, 1, 2], 2), np.ones(6))
        lines = boxes_to_objects(found, TILTED, CLASSES)
        looks = {'truncated': 0.0, 'occluded': int(rng.integers(0, 3)), 'score': None}
        yield f'{number:06d}', [KittiObject(**{**vars(o), **looks}) for o in lines] + [DONT_CARE], TILTED


def check_against_the_program(frames, folder, rng):
    """The metric's numbers, and those of the program's rules on the label and result files."""
    samples, texts = [], []
    for name, objects, calib in frames:
        annotation = SimpleNamespace(objects=tuple(objects), calib=calib, image_size=(1242, 375))
        samples.append(sample(objects, near_misses(objects, calib, rng), name, annotation=annotation))
        texts.append(''.join(format_object(o, full_precision=True) + '\n' for o in objects))
    got = run(samples, sampling='official', export_dir=str(folder), loose_iou_thresholds=None)
    files = [(folder / f'{name}.txt').read_text() for name, _, _ in frames]
    read = [
        {'truth': slow.read_lines(truth, False), 'found': slow.read_lines(found, True)}
        for truth, found in zip(texts, files, strict=True)
    ]
    for name, iou in OFFICIAL_IOU.items():
        for metric in ('bbox', 'bev', '3d'):
            key = f'{name}_{metric}_moderate_R40@{iou:.2f}'
            if key in got:
                want = slow.average_precision(read, name, 'moderate', metric, iou)[0][0]
                assert got[key] == pytest.approx(want, abs=1e-9), key
    lidar = run(samples, sampling='official', frame='lidar', loose_iou_thresholds=None)
    return got, lidar


def test_the_camera_frame_equals_the_program_on_the_files(tmp_path):
    rng = np.random.default_rng(0)
    got, lidar = check_against_the_program(list(worlds(rng)), tmp_path, rng)
    assert 5 < got['Car_3d_moderate_R40@0.70'] < 95
    assert got['mAP_bbox_moderate_R40'] == lidar['mAP_bbox_moderate_R40']
    assert abs(got['mAP_3d_moderate_R40'] - lidar['mAP_3d_moderate_R40']) > 0.1


def test_real_frames_equal_the_program(real_data, tmp_path):
    root = real_data / 'kitti' / 'training'
    names = sorted(path.stem for path in (root / 'label_2').glob('*.txt'))
    frames = [(n, read_objects(root / f'label_2/{n}.txt'), read_calib(root / f'calib/{n}.txt')) for n in names]
    got, _ = check_against_the_program(frames, tmp_path, np.random.default_rng(1))
    assert got['Car_3d_moderate_R40@0.70'] > 0


@pytest.mark.parametrize('place', [(0.0, 0.0, 0.0, 0.0), (-1.0, -1.0, -1.0, -1.0)])
def test_labels_without_2d_boxes_have_no_score_and_the_log_says_why(place, monkeypatch):
    said = []
    monkeypatch.setattr('rm3d_plugin.evaluation.kitti_metric.print_log', lambda text, **_: said.append(text))
    flat = [KittiObject(**{**vars(o), 'bbox': place}) for o in truth_of(BOXES)]
    got = run([sample(flat, BOXES)])
    assert got == {}
    assert said[0] == (
        'KittiMetric: none of the 2 labels Car counts: 2 have a 2D box less than 25 pixels high (zeros and -1 too), '
        "the others are too occluded or truncated; give labels the 2D boxes that KITTI's rules ask for"
    )
    assert 'none of the 1 labels Pedestrian counts' in said[1] and len(said) == 3


def test_sampling_and_frame_stand_in_the_table(monkeypatch):
    said = []
    monkeypatch.setattr('rm3d_plugin.evaluation.kitti_metric.print_log', lambda text, **_: said.append(text))
    run([sample(truth_of(BOXES), BOXES)], metrics=('3d',))
    assert 'boxes in the camera frame, sampled as the official program does from 41 truths on, interpolated' in said[0]
    rows = [' '.join(line.split()) for line in said[0].splitlines()]
    assert 'Car 3d AP R40 @ 0.70, interpolated 100.00 100.00 100.00' in rows
    assert 'mean 3d AP R40 loose, interpolated 100.00 100.00 100.00' in rows
    official = run([sample(truth_of(BOXES), BOXES)], metrics=('3d',), sampling='official')
    assert official['Car_3d_moderate_R40@0.70'] == pytest.approx(2.5)  # one of 40 positions: two truths are too few
    assert 'interpolated' not in said[1]
    with pytest.raises(ValueError, match="KittiMetric.frame: expected one of camera, lidar, got 'world'"):
        KittiMetric(frame='world')
