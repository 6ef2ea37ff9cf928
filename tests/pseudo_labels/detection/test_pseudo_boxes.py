"""Boxes from the faces that a sensor saw: exact on drawn faces, measured on real scans."""

import numpy as np
import pytest
from reference.kitti_frames import frames

from rm3d_plugin.datasets.kitti_format import objects_to_boxes, read_calib, read_objects
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.rotated_iou import rotated_iou_bev
from rm3d_plugin.pseudo_labels.detection import boxes as pb
from rm3d_plugin.pseudo_labels.detection.box_fit import fit_footprint
from rm3d_plugin.pseudo_labels.detection.objects import split_by_votes
from rm3d_plugin.structures import Boxes3D, Regions

CAR = np.array([3.9, 1.6, 1.56])
SIZES = np.array([CAR, [0.8, 0.6, 1.73], [1.76, 0.6, 1.73]])


def faces(box, n=40):
    """Points on the sides of a box that look at the origin."""
    corners = Boxes3D(box[None], np.zeros(1, dtype=int)).corners()[0, :4]
    out = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        middle, along = (a + b)[:2] / 2, (b - a)[:2]
        outward = np.array([along[1], -along[0]])
        outward *= np.sign(outward @ (middle - box[:2]))
        if outward @ middle < 0:
            steps = np.linspace(0, 1, n)[:, None]
            out.append(a + steps * (b - a))
    ground = np.concatenate(out)
    return np.concatenate([ground + [0, 0, z] for z in np.linspace(0, box[5], 4)])


@pytest.mark.parametrize('yaw', np.deg2rad([-80, -45, -10, 0, 20, 63]))
@pytest.mark.parametrize('place', [(12.0, 5.0), (20.0, -9.0), (-8.0, 6.0)])
def test_two_faces_give_the_whole_box(yaw, place):
    box = np.array([*place, -0.8, *CAR, yaw])
    fit = pb.complete_box(faces(box), CAR, ground_z=-0.8 - CAR[2] / 2)
    assert rotated_iou_bev(fit.box[None], box[None])[0, 0] > 0.97
    assert fit.box[2] == pytest.approx(-0.8)
    assert fit.box[5] == pytest.approx(CAR[2])
    assert pb.is_plausible(fit, CAR)


def test_a_rear_face_alone_tells_which_axis_is_the_length():
    box = np.array([15.0, 0.4, 0, *CAR, 0.0])
    rear = faces(box)
    rear = rear[rear[:, 0] < 13.1]
    fit = pb.complete_box(rear, CAR)
    assert rotated_iou_bev(fit.box[None], box[None])[0, 0] > 0.9


def test_a_slender_object_is_centred_on_its_points():
    points = np.array([[10.0, 0, 0.2], [10.2, 0, 1.0], [10.1, 0.2, 1.5], [10.1, -0.2, 0.8]])
    fit = pb.complete_box(points, SIZES[1], ground_z=0.0)
    assert fit.box[:2] == pytest.approx([10.1, 0.0], abs=0.05)
    assert fit.box[2:6] == pytest.approx([1.73 / 2, 0.8, 0.6, 1.73])


def test_strays_do_not_move_a_face():
    box = np.array([15.0, 6.0, 0, *CAR, 0.3])
    points = faces(box)
    strays = np.concatenate([points, [[13.0, 9.0, 0], [18.5, 8.5, 0], [12.0, 3.0, 0]]])
    fit = pb.complete_box(strays, CAR)
    assert rotated_iou_bev(fit.box[None], box[None])[0, 0] > 0.95


def test_few_points():
    one = fit_footprint(np.array([[5.0, 1.0]]), (1.0, 0.5))
    assert one.center == pytest.approx([5.0, 1.0])
    assert one.size == pytest.approx([1.0, 0.5])
    twice = pb.complete_box(np.tile([5.0, 1.0, 0.5], (2, 1)), SIZES[1])
    assert np.isfinite(twice.box).all()
    with pytest.raises(ValueError, match='at least one point'):
        fit_footprint(np.zeros((0, 2)), (1.0, 0.5))


def test_tight_boxes():
    box = np.array([4.0, 3.0, 1.0, 4.0, 2.0, 2.0, 0.5])
    points = Boxes3D(box[None], np.zeros(1, dtype=int)).corners()[0]
    assert pb.tight_box(points) == pytest.approx(box, abs=0.02)
    flat = pb.tight_box(points, yaw_fitted=False)
    assert flat[:3] == pytest.approx([4, 3, 1])
    assert flat[3:] == pytest.approx([*np.ptp(points, axis=0), 0])
    assert pb.tight_box(points[:1])[3:6] == pytest.approx([0.05] * 3)


def test_yaw_lies_in_a_half_turn():
    for yaw in np.linspace(-3, 3, 13):
        fitted = fit_footprint(faces(np.array([10.0, 4.0, 0, *CAR, yaw]))[:, :2], (3.9, 1.6)).yaw
        assert -np.pi / 2 <= fitted < np.pi / 2
        assert np.sin(fitted - yaw) == pytest.approx(0, abs=0.02)


def test_sizes_are_medians():
    boxes = np.zeros((4, 7))
    boxes[:, 3:6] = [[4, 2, 1], [5, 2, 1], [9, 2, 1], [1, 1, 2]]
    priors = pb.median_sizes(boxes, np.array([0, 0, 0, 2]), 3)
    assert priors[0].tolist() == [5, 2, 1]
    assert np.isnan(priors[1]).all()
    assert priors[2].tolist() == [1, 1, 2]


def test_a_group_larger_than_its_class_is_not_plausible():
    def fit(length, width, height):
        return pb.BoxFit(np.array([0, 0, 0, length, width, height, 0.0]), np.array([length, width, height]), 0.0)

    assert pb.is_plausible(fit(5.3, 2.2, 2.1), CAR)
    assert pb.is_plausible(fit(2.2, 5.3, 2.1), CAR)
    assert not pb.is_plausible(fit(5.4, 1.0, 1.0), CAR)
    assert not pb.is_plausible(fit(3.0, 2.4, 1.0), CAR)
    assert not pb.is_plausible(fit(3.0, 1.0, 2.3), CAR)


def test_what_no_object_can_be_is_background():
    extents = np.array([[12.0, 3, 0.1], [4.2, 1.6, 1.5], [0.3, 0.2, 0.1], [4, 3.5, 0.1]])
    heights = np.array([2.0, 1.5, 4.0, 1.0])
    assert pb.geometric_background(extents, heights, SIZES).tolist() == [True, False, True, True]
    assert pb.geometric_background(extents, None, SIZES).tolist() == [True, False, False, True]
    assert not pb.geometric_background(extents, heights, np.full((3, 3), np.nan)).any()


def test_robust_extents_of_an_even_plate_with_strays():
    rng = np.random.default_rng(0)
    plate = rng.random((2000, 3)) * [4, 2, 0.1] @ np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    plate[:60] += 30 * rng.random((60, 3))
    regions = Regions(np.zeros(2000, dtype=np.int64))
    plain = pb.robust_extents(plate[60:], Regions(np.zeros(1940, dtype=np.int64)))[0]
    assert plain == pytest.approx([4, 2, 0.1], rel=0.05)
    assert pb.robust_extents(plate, regions)[0, 0] < 6
    assert pb.region_tops(np.linspace(0, 1, 2000), regions) == pytest.approx([0.9])


def test_suppression():
    rows = np.array([[0.0, 0, 0, 4, 2, 1, 0], [0.5, 0, 0, 4, 2, 1, 0], [10, 0, 0, 4, 2, 1, 0], [30, 0, 0, 4, 2, 1, 0]])
    boxes = Boxes3D(rows, np.zeros(4, dtype=int))
    true = Boxes3D(np.array([[10.0, 0.2, 5, 4, 2, 1, 0]]), np.zeros(1, dtype=int))
    assert pb.suppress(boxes, np.array([1.0, 2, 9, 1]), true).tolist() == [1, 1, -1, 3]
    assert pb.suppress(boxes, np.ones(4), Boxes3D.empty()).tolist() == [0, 0, 2, 3]
    assert len(pb.suppress(Boxes3D.empty(), np.zeros(0), true)) == 0


def test_votes_split_a_group_of_two():
    centers = np.array([[0.0, 0, 0], [0.1, 0, 0], [1, 0, 9], [1.1, 0, 0], [1.2, 0, 0], [np.nan] * 3])
    assert split_by_votes(centers, 0.3).tolist() == [1, 1, 0, 0, 0, -1]
    assert split_by_votes(np.zeros((0, 3)), 0.3).tolist() == []


def real_objects(folder):
    """(class, box, its points more than 0.2 m above its bottom) of every labelled object of the real frames."""
    root = folder / 'kitti/training'
    for name in frames(folder):
        points = np.fromfile(root / f'velodyne/{name}.bin', dtype=np.float32).reshape(-1, 4)[:, :3]
        calib = read_calib(root / f'calib/{name}.txt')
        boxes = objects_to_boxes(read_objects(root / f'label_2/{name}.txt'), calib, ('Car', 'Pedestrian', 'Cyclist'))
        owner = points_in_boxes(points, boxes.tensor)
        for row, (box, label) in enumerate(zip(boxes.tensor, boxes.labels, strict=True)):
            own = points[(owner == row) & (points[:, 2] > box[2] - box[5] / 2 + 0.2)]
            if len(own) >= (30 if label == 0 else 10):
                yield int(label), box, own


def test_completed_boxes_of_real_objects(real_data):
    """24 cars, 21 pedestrians, 4 cyclists; a box of the usual size at the true place reaches .87 / .64 / .82."""
    overlap = {0: [], 1: [], 2: []}
    for label, box, points in real_objects(real_data):
        fit = pb.complete_box(points, SIZES[label], ground_z=float(box[2] - box[5] / 2))
        overlap[label].append(rotated_iou_bev(fit.box[None], box[None])[0, 0])
    cars, people, cyclists = (np.array(overlap[c]) for c in range(3))
    assert (len(cars), len(people), len(cyclists)) == (24, 21, 4)
    assert (cars >= 0.5).mean() == 1.0 and (cars >= 0.7).mean() >= 0.95 and cars.mean() > 0.83
    assert (people >= 0.25).mean() == 1.0 and (people >= 0.5).mean() >= 0.85
    assert (cyclists >= 0.5).mean() == 1.0
