import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.ops.boxes import nms_bev, points_in_boxes, rotated_iou_3d, rotated_iou_bev
from tests.reference import polygon_iou_slow as slow

CAR = np.array([[1.0, 2.0, 0.5, 4.0, 2.0, 1.5, 0.3]])


def random_boxes(seed, count, spread=3.0):
    rng = np.random.default_rng(seed)
    return np.c_[
        rng.normal(0, spread, (count, 2)),
        rng.normal(0, 0.5, count),
        rng.uniform(0.3, 5, (count, 3)),
        rng.uniform(-7, 7, count),
    ]


def moved(box, **change):
    out = np.array(box, dtype=np.float64)
    names = ('x', 'y', 'z', 'dx', 'dy', 'dz', 'yaw')
    for name, value in change.items():
        out[:, names.index(name)] += value
    return out


class TestIou:
    def test_identical_boxes_overlap_fully(self):
        for seed in range(5):
            boxes = random_boxes(seed, 20)
            assert (np.diag(rotated_iou_bev(boxes, boxes)) == 1).all()
            np.testing.assert_allclose(np.diag(rotated_iou_3d(boxes, boxes)), 1, atol=1e-12)

    @pytest.mark.parametrize('turn', [np.pi, -np.pi, 2 * np.pi])
    def test_half_and_full_turns_change_nothing(self, turn):
        assert rotated_iou_bev(CAR, moved(CAR, yaw=turn))[0, 0] == pytest.approx(1, abs=1e-12)

    def test_hand_worked(self):
        flat = np.array([[0.0, 0, 0, 4, 2, 2, 0]])
        assert rotated_iou_bev(flat, moved(flat, x=2))[0, 0] == pytest.approx(1 / 3, abs=1e-15)
        assert rotated_iou_3d(flat, moved(flat, x=2, z=1))[0, 0] == pytest.approx(4 / 28, abs=1e-15)
        # A cross of two 4 x 2 boxes shares a 2 x 2 square.
        assert rotated_iou_bev(flat, moved(flat, yaw=np.pi / 2))[0, 0] == pytest.approx(4 / 12, abs=1e-12)
        # A unit square and itself turned by 45 degrees share a regular octagon of area 2 (sqrt 2 - 1).
        square = np.array([[5.0, -3, 0, 1, 1, 1, 0.2]])
        octagon = 2 * (np.sqrt(2) - 1)
        got = rotated_iou_bev(square, moved(square, yaw=np.pi / 4))[0, 0]
        assert got == pytest.approx(octagon / (2 - octagon), abs=1e-12)

    def test_touching_and_apart_share_exactly_nothing(self):
        flat = np.array([[0.0, 0, 0, 4, 2, 2, 0]])
        assert rotated_iou_bev(flat, moved(flat, x=4))[0, 0] == 0
        assert rotated_iou_bev(flat, moved(flat, x=4, y=2))[0, 0] == 0
        assert rotated_iou_bev(flat, moved(flat, x=4.5))[0, 0] == 0
        assert rotated_iou_3d(flat, moved(flat, z=2))[0, 0] == 0
        assert rotated_iou_3d(flat, moved(flat, z=5))[0, 0] == 0

    def test_contained(self):
        small = np.array([[1.0, 2.0, 0.5, 1.0, 0.5, 0.5, 1.9]])
        assert rotated_iou_bev(CAR, small)[0, 0] == pytest.approx(0.5 / 8, abs=1e-12)
        assert rotated_iou_bev(small, CAR)[0, 0] == pytest.approx(0.5 / 8, abs=1e-12)
        assert rotated_iou_3d(CAR, small)[0, 0] == pytest.approx(0.25 / 12, abs=1e-12)

    def test_equals_the_slow_twin(self):
        a, b = random_boxes(1, 40), random_boxes(2, 50)
        bev = np.array([[slow.iou_bev(p, q) for q in b] for p in a])
        solid = np.array([[slow.iou_3d(p, q) for q in b] for p in a])
        assert (bev > 0).mean() > 0.25
        np.testing.assert_allclose(rotated_iou_bev(a, b), bev, atol=1e-11)
        np.testing.assert_allclose(rotated_iou_3d(a, b), solid, atol=1e-11)

    def test_equals_monte_carlo(self):
        rng = np.random.default_rng(0)
        points = np.c_[rng.uniform(-4, 4, (400_000, 2)), np.zeros(400_000)]
        for seed in range(6):
            pair = random_boxes(seed, 2, spread=0.7)
            pair[:, 2], pair[:, 3:5] = 0, np.minimum(pair[:, 3:5], 3)
            inside = [points_in_boxes(points, box[None]) == 0 for box in pair]
            union = (inside[0] | inside[1]).sum()
            assert rotated_iou_bev(pair[:1], pair[1:])[0, 0] == pytest.approx(
                (inside[0] & inside[1]).sum() / union, abs=0.01
            )

    @settings(derandomize=True, deadline=None, max_examples=60)
    @given(st.integers(0, 10_000), st.floats(-np.pi, np.pi), st.floats(-1000, 1000))
    def test_symmetric_bounded_and_unmoved_by_rigid_motion(self, seed, turn, shift):
        a, b = random_boxes(seed, 4, 1.5), random_boxes(seed + 1, 4, 1.5)
        iou = rotated_iou_bev(a, b)
        assert ((iou >= 0) & (iou <= 1)).all()
        np.testing.assert_allclose(rotated_iou_bev(b, a).T, iou, atol=1e-12)

        def move(boxes):
            c, s = np.cos(turn), np.sin(turn)
            out = boxes.copy()
            out[:, 0], out[:, 1] = boxes[:, 0] * c - boxes[:, 1] * s + shift, boxes[:, 0] * s + boxes[:, 1] * c - shift
            out[:, 6] += turn
            return out

        np.testing.assert_allclose(rotated_iou_bev(move(a), move(b)), iou, atol=1e-9)

    def test_empty_and_flat_boxes(self):
        none = np.zeros((0, 7))
        assert rotated_iou_bev(none, CAR).shape == (0, 1)
        assert rotated_iou_3d(CAR, none).shape == (1, 0)
        assert rotated_iou_bev(np.zeros((1, 7)), np.zeros((1, 7)))[0, 0] == 0
        line = np.array([[1.0, 2.0, 0.5, 4.0, 0.0, 1.5, 0.3]])
        assert rotated_iou_bev(CAR, line)[0, 0] == 0

    def test_bad_boxes_are_refused(self):
        with pytest.raises(ValueError, match=r'shape \(M, 7\), got \(1, 6\)'):
            rotated_iou_bev(CAR[:, :6], CAR)
        with pytest.raises(ValueError, match='b: 1 of 1 boxes hold a NaN'):
            rotated_iou_3d(CAR, moved(CAR, x=np.nan))
        with pytest.raises(ValueError, match='sizes must not be negative'):
            rotated_iou_bev(moved(CAR, dx=-9), CAR)


class TestPointsInBoxes:
    def test_equals_the_obvious_loop(self):
        rng = np.random.default_rng(3)
        points, boxes = rng.normal(0, 3, (500, 3)), random_boxes(4, 12)
        for margin in (0.0, 0.4, -0.1):
            expected = []
            for p in points:
                found = -1
                for j in range(len(boxes) - 1, -1, -1):
                    x, y, z, dx, dy, dz, yaw = boxes[j]
                    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
                    local = np.abs(np.append(turn @ (p[:2] - [x, y]), p[2] - z))
                    if (local <= np.array([dx, dy, dz]) / 2 + margin).all():
                        found = j
                expected.append(found)
            got = points_in_boxes(points, boxes, margin)
            assert got.dtype == np.int64
            np.testing.assert_array_equal(got, expected)

    def test_the_lowest_box_wins_and_faces_belong_to_it(self):
        flat = np.array([[0.0, 0, 0, 4, 2, 2, 0]])
        twice = np.concatenate([moved(flat, x=1), flat])
        points = np.array([[0.5, 0, 0], [-2, 1, 1], [-2.01, 0, 0], [3, -1, -1]])
        np.testing.assert_array_equal(points_in_boxes(points, twice), [0, 1, -1, 0])

    def test_empty_single_duplicate_nan(self):
        assert points_in_boxes(np.zeros((0, 3)), CAR).shape == (0,)
        np.testing.assert_array_equal(points_in_boxes(np.zeros((2, 3)), np.zeros((0, 7))), [-1, -1])
        np.testing.assert_array_equal(
            points_in_boxes(np.array([[1, 2, 0.5]] * 2 + [[np.nan, 2, 0.5]]), CAR), [0, 0, -1]
        )

    def test_intensity_columns_and_float32_are_fine(self):
        points = np.array([[1, 2, 0.5, 99]], dtype=np.float32)
        np.testing.assert_array_equal(points_in_boxes(points, CAR), [0])

    def test_bad_points_are_refused(self):
        with pytest.raises(ValueError, match=r'expected shape \(N, 3\), got \(3, 2\)'):
            points_in_boxes(np.zeros((3, 2)), CAR)


class TestNms:
    def test_best_first_ties_to_the_lowest_index(self):
        boxes = np.concatenate([CAR, moved(CAR, x=0.1), moved(CAR, x=20), CAR])
        np.testing.assert_array_equal(nms_bev(boxes, np.array([0.5, 0.9, 0.1, 0.9]), 0.25), [1, 2])
        np.testing.assert_array_equal(nms_bev(boxes, np.full(4, 0.5), 0.25), [0, 2])

    def test_threshold_is_exceeded_not_met(self):
        flat = np.array([[0.0, 0, 0, 4, 2, 1, 0]])
        pair = np.concatenate([flat, moved(flat, x=2)])  # IoU 1/3
        iou = rotated_iou_bev(pair[:1], pair[1:])[0, 0]
        assert len(nms_bev(pair, np.ones(2), iou)) == 2
        assert len(nms_bev(pair, np.ones(2), np.nextafter(iou, 0))) == 1

    def test_a_removed_box_removes_none(self):
        flat = np.array([[0.0, 0, 0, 4, 2, 1, 0]])
        chain = np.concatenate([flat, moved(flat, x=2), moved(flat, x=4)])
        np.testing.assert_array_equal(nms_bev(chain, np.array([0.9, 0.8, 0.7]), 0.2), [0, 2])

    def test_classes_do_not_compete(self):
        boxes = np.repeat(CAR, 3, axis=0)
        np.testing.assert_array_equal(nms_bev(boxes, np.array([0.1, 0.2, 0.3]), 0.1, np.array([0, 1, 0])), [2, 1])

    def test_equals_the_obvious_loop(self):
        boxes = random_boxes(8, 80)
        scores = np.round(np.random.default_rng(9).random(80), 1)  # many ties
        order = sorted(range(80), key=lambda i: (-scores[i], i))
        kept = []
        for i in order:
            if all(slow.iou_bev(boxes[k], boxes[i]) <= 0.1 for k in kept):
                kept.append(i)
        np.testing.assert_array_equal(nms_bev(boxes, scores, 0.1), kept)

    def test_empty_and_bad(self):
        assert nms_bev(np.zeros((0, 7)), np.zeros(0), 0.5).shape == (0,)
        with pytest.raises(ValueError, match='1 boxes, 2 scores'):
            nms_bev(CAR, np.ones(2), 0.5)
        with pytest.raises(ValueError, match='1 of 1 scores are NaN'):
            nms_bev(CAR, np.array([np.nan]), 0.5)
