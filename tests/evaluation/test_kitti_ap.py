import numpy as np
import pytest

from rm3d_plugin.evaluation.functional import LOOSE_IOU, OFFICIAL_IOU, KittiDetections, KittiTruth, kitti_ap
from rm3d_plugin.evaluation.functional.kitti_ap import recall_thresholds
from rm3d_plugin.evaluation.functional.kitti_matching import image_overlap
from rm3d_plugin.evaluation.kitti_table import format_table, kitti_records
from tests.reference import kitti_ap_slow as slow

CAR_BOX = np.array([20.0, 0, -1, 4, 1.8, 1.5, 0.1])
TALL = np.array([100.0, 100, 180, 160])  # 60 px


def frame_of(truth=(), found=()):
    """Rows (type, place along y, changes) become both sides of a frame."""
    rows = [[], []]
    for side, items in zip(rows, (truth, found), strict=True):
        for name, place, *more in items:
            change = more[0] if more else {}
            box = CAR_BOX + [0, 6.0 * place, 0, 0, 0, 0, 0]
            image = TALL + [90 * place, 0, 90 * place, 0]
            if 'height' in change:
                image = np.array([image[0], 100, image[2], 100 + change['height']])
            item = {
                'type': name,
                'box': box,
                'bbox': image,
                'alpha': 0.0,
                'score': 0.9,
                'truncated': 0.0,
                'occluded': 0,
            }
            side.append(item | {k: v for k, v in change.items() if k != 'height'})
    return {'truth': rows[0], 'found': rows[1]}


def sides(frames):
    def column(items, key, shape=(-1,)):
        return np.array([item[key] for item in items], dtype=np.float64).reshape(shape)

    truths = [
        KittiTruth(
            [t['type'] for t in f['truth']],
            column(f['truth'], 'truncated'),
            column(f['truth'], 'occluded').astype(int),
            column(f['truth'], 'bbox', (-1, 4)),
            column(f['truth'], 'box', (-1, 7)),
            column(f['truth'], 'alpha'),
        )
        for f in frames
    ]
    found = [
        KittiDetections(
            [d['type'] for d in f['found']],
            column(f['found'], 'bbox', (-1, 4)),
            column(f['found'], 'box', (-1, 7)),
            column(f['found'], 'score'),
            column(f['found'], 'alpha'),
        )
        for f in frames
    ]
    return truths, found


def evaluate(*frames, **options):
    return kitti_ap(*sides(frames), **{'sampling': 'auto', **options})


def car(table, metric='3d', difficulty='moderate'):
    return table.cell('Car', metric, difficulty)


class TestByHand:
    def test_perfect_is_100_everywhere(self):
        table = evaluate(
            frame_of([('Car', 0), ('Car', 1)], [('Car', 1), ('Car', 0)]), frame_of([('Car', 0)], [('Car', 0)])
        )
        for metric in ('bbox', 'aos', 'bev', '3d'):
            for difficulty in ('easy', 'moderate', 'hard'):
                cell = car(table, metric, difficulty)
                assert (cell.r40, cell.r11, cell.num_truth) == (pytest.approx(100), pytest.approx(100), 3)

    def test_nothing_found_is_0(self):
        assert car(evaluate(frame_of([('Car', 0)]))).r40 == 0
        assert car(evaluate(frame_of([('Car', 0)], [('Car', 3)]))).r40 == 0

    def test_one_of_two_found(self):
        cell = car(evaluate(frame_of([('Car', 0), ('Car', 1)], [('Car', 0)])))
        assert cell.r40 == pytest.approx(50)  # recall 1/40 ... 20/40
        assert cell.r11 == pytest.approx(100 * 6 / 11)  # recall 0, .1 ... .5

    def test_a_duplicate_costs_precision(self):
        frame = frame_of([('Car', 0), ('Car', 1)], [('Car', 0), ('Car', 0, {'score': 0.8}), ('Car', 1, {'score': 0.7})])
        # Up to recall 1/2 precision is 1; beyond it two of three detections hit.
        assert car(evaluate(frame)).r40 == pytest.approx(100 * (20 + 20 * 2 / 3) / 40)

    def test_a_late_false_positive_costs_nothing(self):
        frame = frame_of([('Car', 0)], [('Car', 0), ('Car', 3, {'score': 0.1})])
        assert car(evaluate(frame)).r40 == pytest.approx(100)

    def test_an_early_false_positive_halves_precision(self):
        frame = frame_of([('Car', 0)], [('Car', 0), ('Car', 3, {'score': 0.95})])
        assert car(evaluate(frame)).r40 == pytest.approx(50)

    def test_van_is_neither_hit_nor_miss(self):
        with_van = evaluate(frame_of([('Car', 0), ('Van', 1)], [('Car', 0), ('Car', 1, {'score': 0.99})]))
        assert car(with_van).r40 == pytest.approx(100)
        assert car(with_van).num_truth == 1
        assert car(evaluate(frame_of([('Car', 0), ('Van', 1)], [('Car', 0)]))).r40 == pytest.approx(100)
        # A truck is no neighbour: the same detection is a false positive.
        truck = evaluate(frame_of([('Car', 0), ('Truck', 1)], [('Car', 0), ('Car', 1, {'score': 0.99})]))
        assert car(truck).r40 == pytest.approx(50)

    def test_sitting_person_is_ignored_for_pedestrians(self):
        frame = frame_of(
            [('Pedestrian', 0), ('Person_sitting', 1)], [('Pedestrian', 0), ('Pedestrian', 1, {'score': 0.99})]
        )
        assert evaluate(frame).cell('Pedestrian', '3d', 'easy').r40 == pytest.approx(100)

    def test_dontcare_forgives_in_2d_only(self):
        dont_care = ('DontCare', 3, {'box': [-1000.0, -1000, -1000, -1, -1, -1, -10], 'truncated': -1, 'occluded': -1})
        frame = frame_of([('Car', 0), dont_care], [('Car', 0), ('Car', 3, {'score': 0.99})])
        table = evaluate(frame)
        assert car(table, 'bbox').r40 == pytest.approx(100)
        assert car(table, 'bev').r40 == pytest.approx(50)
        assert car(table, '3d').r40 == pytest.approx(50)

    @pytest.mark.parametrize(
        ('height', 'counts'), [(24.99, (0, 0, 0)), (25, (0, 1, 1)), (39.9, (0, 1, 1)), (40, (1, 1, 1))]
    )
    def test_truth_below_the_height_limit_is_ignored(self, height, counts):
        table = evaluate(frame_of([('Car', 0, {'height': height})], [('Car', 0)]))
        assert tuple(car(table, '3d', d).num_truth for d in ('easy', 'moderate', 'hard')) == counts

    def test_small_detections_are_ignored(self):
        frame = frame_of([('Car', 0)], [('Car', 0), ('Car', 3, {'score': 0.99, 'height': 24.0})])
        assert car(evaluate(frame)).r40 == pytest.approx(100)
        # One that alone covers a truth makes the truth neither hit nor miss.
        frame = frame_of([('Car', 0), ('Car', 1)], [('Car', 0, {'height': 24.0}), ('Car', 1)])
        assert car(evaluate(frame)).r40 == pytest.approx(50)

    @pytest.mark.parametrize(
        ('field', 'value', 'counts'),
        [
            ('occluded', 1, (0, 1, 1)),
            ('occluded', 2, (0, 0, 1)),
            ('occluded', 3, (0, 0, 0)),
            ('truncated', 0.2, (0, 1, 1)),
        ]
        + [('truncated', 0.4, (0, 0, 1)), ('truncated', 0.5, (0, 0, 1)), ('truncated', 0.51, (0, 0, 0))],
    )
    def test_occlusion_and_truncation(self, field, value, counts):
        table = evaluate(frame_of([('Car', 0, {field: value})], [('Car', 0)]))
        assert tuple(car(table, '3d', d).num_truth for d in ('easy', 'moderate', 'hard')) == counts

    def test_overlap_must_exceed_the_threshold(self):
        shifted = CAR_BOX + [0, 0, 0.5, 0, 0, 0, 0]  # a third of the height: 3D IoU 1/2
        frame = frame_of([('Car', 0)], [('Car', 0, {'box': shifted})])
        assert car(evaluate(frame)).r40 == 0
        assert car(evaluate(frame), 'bev').r40 == pytest.approx(100)
        assert car(evaluate(frame, iou_thresholds={**LOOSE_IOU, 'Car': 0.49})).r40 == pytest.approx(100)

    def test_orientation_counts_by_its_cosine(self):
        frame = frame_of([('Car', 0)], [('Car', 0, {'alpha': np.pi / 2})])
        table = evaluate(frame)
        assert car(table, 'aos').r40 == pytest.approx(50)
        assert car(table, 'bbox').r40 == pytest.approx(100)

    def test_predictions_without_truth_do_not_spoil_the_mean(self):
        table = evaluate(frame_of([('Car', 0)], [('Car', 0), ('Cyclist', 4)]))
        assert np.isnan(table.cell('Cyclist', '3d', 'easy').r40)
        assert table.mean('3d', 'easy') == pytest.approx(100)
        assert np.isnan(evaluate(frame_of([], [('Car', 0)])).mean('3d', 'easy'))

    def test_frames_stay_apart(self):
        frames = [frame_of([('Car', 0)]), frame_of([], [('Car', 0)])]
        assert car(evaluate(*frames)).r40 == 0

    def test_letter_case_does_not_matter(self):
        assert car(evaluate(frame_of([('car', 0)], [('CAR', 0)]))).r40 == pytest.approx(100)


class TestSampling:
    def test_thresholds_of_a_hundred_hits_are_every_fortieth_of_recall(self):
        got = recall_thresholds(np.arange(100) / 100, 100)
        assert len(got) == 41
        recall = (100 - 100 * got) / 100
        np.testing.assert_allclose(recall[1:], np.arange(1, 41) / 40, atol=0.011)

    def test_the_official_program_cannot_reach_100_with_ten_truths(self):
        frame = frame_of([('Car', i) for i in range(10)], [('Car', i, {'score': 0.9 - i / 100}) for i in range(10)])
        assert car(evaluate(frame, sampling='official')).r40 == pytest.approx(22.5)
        assert car(evaluate(frame)).r40 == pytest.approx(100)

    def test_with_many_truths_the_samplings_agree(self):
        frames = random_frames(5, 400)
        a, b = (evaluate(*frames, sampling=s) for s in ('official', 'interpolated'))
        assert car(a).num_truth > 80
        assert car(a).r40 == pytest.approx(car(b).r40, abs=1.5)
        assert car(evaluate(*frames)).r40 == car(a).r40


def random_frames(seed, count):
    """Frames with near misses, duplicates, wrong classes, all heights and difficulties, ignored classes, DontCare."""
    rng = np.random.default_rng(seed)
    frames = []
    for _ in range(count):
        truth, found = [], []
        for place in range(rng.integers(0, 7)):
            name = rng.choice(['Car', 'Car', 'Car', 'Pedestrian', 'Cyclist', 'Van', 'Person_sitting', 'DontCare'])
            height = float(rng.choice([20, 24, 25, 30, 39, 40, 60, 60, 60]))
            look = {
                'occluded': rng.integers(0, 4),
                'truncated': rng.choice([0, 0.1, 0.2, 0.4, 0.6]),
                'alpha': rng.normal(),
            }
            truth.append((str(name), place, look | {'height': height}))
            for _ in range(rng.integers(0, 3)):
                kind = str(name) if rng.random() < 0.8 and name in OFFICIAL_IOU else str(rng.choice(list(OFFICIAL_IOU)))
                off = rng.normal(0, 0.08, 7) * [1, 1, 0.5, 0.5, 0.3, 0.3, 0.3]
                tall = height + rng.choice([-1, 0, 0, 0, 1])
                change = {
                    'box': CAR_BOX + [0, 6.0 * place, 0, 0, 0, 0, 0] + off,
                    'score': rng.random(),
                    'alpha': rng.normal(),
                }
                found.append((kind, place, change | {'height': tall}))
        if rng.random() < 0.5:
            found.append(('Car', 9, {'score': rng.random()}))
        frames.append(frame_of(truth, found))
    return frames


@pytest.mark.parametrize('seed', [0, 1])
def test_equals_the_slow_evaluator(seed):
    frames = random_frames(seed, 120)
    table = evaluate(*frames, sampling='official')
    nonzero = 0
    for name in OFFICIAL_IOU:
        for difficulty in ('easy', 'moderate', 'hard'):
            for metric in ('bbox', 'bev', '3d'):
                cell = table.cell(name, metric, difficulty)
                if not cell.num_truth:
                    continue
                plain, turned = slow.average_precision(frames, name, difficulty, metric, OFFICIAL_IOU[name])
                assert (cell.r40, cell.r11) == (pytest.approx(plain[0], abs=1e-9), pytest.approx(plain[1], abs=1e-9))
                nonzero += plain[0] > 0
                if metric == 'bbox':
                    aos = table.cell(name, 'aos', difficulty)
                    assert (aos.r40, aos.r11) == (pytest.approx(turned[0]), pytest.approx(turned[1]))
    assert nonzero > 20


class TestInput:
    def test_no_frames(self):
        assert np.isnan(kitti_ap([], []).mean('3d', 'moderate'))

    def test_wrong_options_are_named(self):
        with pytest.raises(ValueError, match="sampling: expected .* got 'r40'"):
            kitti_ap([], [], sampling='r40')
        with pytest.raises(ValueError, match="metrics: expected some of bbox, aos, bev, 3d, got '4d'"):
            kitti_ap([], [], metrics=('4d',))
        with pytest.raises(ValueError, match="no value for class 'Tram'"):
            kitti_ap([], [], classes=('Tram',))

    def test_rows_must_fit(self):
        truths, found = sides([frame_of([('Car', 0)], [('Car', 0)])])
        with pytest.raises(ValueError, match='1 frames of truth, 0 of detections'):
            kitti_ap(truths, [])
        with pytest.raises(ValueError, match='frame 0, detections.scores: expected 1 rows, got 2'):
            kitti_ap(truths, [KittiDetections(['Car'], found[0].bbox2d, found[0].boxes3d, np.zeros(2))])
        nan = KittiDetections(['Car'], found[0].bbox2d, found[0].boxes3d, np.array([np.nan]))
        with pytest.raises(ValueError, match='frame 0, detections.scores: a score is NaN'):
            kitti_ap(truths, [nan])

    def test_without_alpha_there_is_no_orientation(self):
        truths, found = sides([frame_of([('Car', 0)], [('Car', 0)])])
        blind = KittiDetections(found[0].types, found[0].bbox2d, found[0].boxes3d, found[0].scores)
        assert {entry.metric for entry in kitti_ap(truths, [blind]).entries} == {'bbox', 'bev', '3d'}


def test_image_overlap_by_hand():
    a = np.array([[0.0, 0, 10, 10]])
    b = np.array([[5.0, 0, 15, 10], [10, 0, 20, 10], [2, 2, 4, 4], [3, 3, 3, 3]])
    np.testing.assert_allclose(image_overlap(a, b), [[1 / 3, 0, 0.04, 0]])
    np.testing.assert_allclose(image_overlap(a, b, of_b=True), [[0.5, 0, 1, 0]])


def test_names_and_table():
    records = kitti_records(evaluate(frame_of([('Car', 0), ('Car', 1)], [('Car', 0)])), 'loose')
    named = {record.key: record.value for record in records}
    assert named['Car_3d_moderate_R40@0.70'] == pytest.approx(50)
    assert named['mAP_3d_moderate_R40_loose'] == pytest.approx(50)
    assert not any(key.startswith('Cyclist') for key in named)
    assert all(np.isfinite(value) for value in named.values())
    lines = [line.split() for line in format_table(records).splitlines()]
    assert ['Car', '3d', 'AP', 'R40', '@', '0.70,', 'interpolated', '50.00', '50.00', '50.00'] in lines
    assert ['mean', '3d', 'AP', 'R40', 'loose,', 'interpolated', '50.00', '50.00', '50.00'] in lines
    assert format_table(records[:1]).splitlines()[-1].split()[-2:] == ['-', '-']
