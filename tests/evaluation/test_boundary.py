import numpy as np
import pytest
from reference.boundary_slow import slow_boundary, slow_oracle_iou

from rm3d_plugin.evaluation import OversegMetric
from rm3d_plugin.evaluation.functional.boundary import boundary_counts, boundary_scores, neighbor_edges, scores_of
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import SceneError


def line(count):
    """Points 1, 2, 4, 7 ... apart by little more each: the nearest point of each is the one before."""
    return np.c_[np.cumsum(1 + 0.001 * np.arange(count)), np.zeros((count, 2))]


@pytest.mark.parametrize('seed', range(4))
def test_equals_the_slow_twin(seed):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 1, (150, 3)).astype(np.float32)
    classes = (xyz[:, 0] * 3).astype(int)
    classes[rng.uniform(size=150) < 0.1] = 255
    regions = (xyz[:, 0] * 4).astype(int) * 4 + (xyz[:, 1] * 4).astype(int)
    regions[rng.uniform(size=150) < 0.1] = -1
    objects = classes * 2 + (xyz[:, 2] > 0.5) if seed % 2 else None
    scores = boundary_scores(xyz, classes, regions, 4, objects)
    recall, precision = slow_boundary(xyz, classes, regions, objects=objects)
    assert scores[:3] == pytest.approx((recall, precision, 2 * recall * precision / (recall + precision)))
    iou = slow_oracle_iou(classes, regions, 4)
    np.testing.assert_allclose(scores.oracle_iou, iou)
    assert scores.oracle_miou == pytest.approx(np.nanmean(iou))
    assert np.isnan(scores.oracle_iou[3])


def test_worked_by_hand():
    # A chain 0-1-2-...-9 with objects 0..4 | 5..9 and regions 0..5 | 6..7 | 8..9. True edge 4-5; region edges 5-6, 7-8.
    xyz, classes = line(10), np.repeat([0, 1], 5)
    regions = np.array([0] * 6 + [1, 1, 2, 2])
    scores = boundary_scores(xyz, classes, regions, 2, neighbors=1)
    assert scores.recall == 1.0 and scores.precision == 0.5 and scores.f1 == pytest.approx(2 / 3)
    assert scores.oracle_accuracy == 0.9 and scores.regions == 3
    np.testing.assert_allclose(scores.oracle_iou, [5 / 6, 4 / 5])
    strict = boundary_scores(xyz, classes, regions, 2, neighbors=1, tolerance=0)
    assert strict[:3] == (0.0, 0.0, 0.0)
    assert boundary_scores(xyz, classes, regions, 2, neighbors=1, tolerance=3).precision == 1.0


def test_perfect_and_single_regions():
    xyz, classes = line(10), np.repeat([0, 1], 5)
    perfect = boundary_scores(xyz, classes, classes + 7, 2)
    assert (perfect.recall, perfect.precision, perfect.f1, perfect.oracle_miou) == (1, 1, 1, 1)
    one = boundary_scores(xyz, classes, np.zeros(10, dtype=int), 2)
    assert (one.recall, one.precision, one.f1, one.oracle_miou) == (0, 1, 0, 0.25)
    each = boundary_scores(xyz, classes, np.arange(10), 2, neighbors=1)
    assert each.recall == 1 and each.precision == 3 / 9 and each.oracle_miou == 1
    nothing = boundary_scores(xyz, np.zeros(10, dtype=int), np.zeros(10, dtype=int), 2)
    assert (nothing.recall, nothing.precision, nothing.f1, nothing.oracle_miou) == (1, 1, 1, 1)


def test_discarded_points_are_wrong_and_ignored_ones_do_not_count():
    xyz, classes = line(10), np.repeat([0, 1], 5)
    regions = np.array([0] * 5 + [-1] * 5)
    scores = boundary_scores(xyz, classes, regions, 2)
    assert scores.recall == 1 and scores.oracle_accuracy == 0.5 and scores.oracle_iou.tolist() == [1, 0]
    ignored = np.where(classes == 1, 255, classes)
    scores = boundary_scores(xyz, ignored, regions, 2)
    assert scores.oracle_accuracy == 1 and scores.oracle_miou == 1 and scores.recall == scores.precision == 1


def test_edges_of_duplicates_and_of_few_points():
    xyz = np.zeros((4, 3))
    assert neighbor_edges(xyz, 1).tolist() == [[0, 1], [0, 2], [0, 3]]
    assert neighbor_edges(xyz, 2).tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]]
    assert neighbor_edges(np.array([[0.0, 0, 0], [1, 0, 0]]), 5).tolist() == [[0, 1]]
    for count in (0, 1):
        labels = np.zeros(count, dtype=int)
        assert neighbor_edges(np.zeros((count, 3)), 5).shape == (0, 2)
        scores = boundary_scores(np.zeros((count, 3)), labels, labels, 1)
        assert scores.f1 == 1 and scores.regions == count and (scores.oracle_miou == 1) == bool(count)


def test_wrong_input_is_named():
    xyz, labels = np.zeros((3, 3)), np.zeros(3, dtype=int)
    with pytest.raises(ValueError, match='3 points, 2 classes, 3 regions'):
        boundary_scores(xyz, labels[:2], labels, 1)
    with pytest.raises(ValueError, match='expected 0..0, -1 or 255, got 0..4'):
        boundary_scores(xyz, np.array([0, 4, 255]), labels, 1)
    with pytest.raises(ValueError, match='neighbors >= 1'):
        boundary_scores(xyz, labels, labels, 1, neighbors=0)
    with pytest.raises(ValueError, match='NaN or infinite'):
        boundary_scores(np.full((3, 3), np.nan), labels, labels, 1)


def sample(rng):
    xyz = rng.uniform(0, 1, (80, 4))
    return {
        'points': xyz,
        'pts_semantic_mask': (xyz[:, 0] * 2).astype(int),
        'pred_pts_region_mask': (xyz[:, 0] * 3).astype(int),
    }


def test_metric_adds_the_scenes_up():
    rng = np.random.default_rng(0)
    scenes = [sample(rng), sample(rng)]
    metric = METRICS.build(dict(type='OversegMetric', num_classes=2))
    metric.process(None, scenes[:1])
    metric.process(None, scenes[1:])
    got = metric.evaluate(2)
    counts = [boundary_counts(s['points'][:, :3], *list(s.values())[1:], 2) for s in scenes]
    want = scores_of(counts[0] + counts[1])
    assert got['boundary_f1'] == pytest.approx(100 * want.f1) and 0 < want.f1 < 1
    assert got['oracle_miou'] == pytest.approx(100 * want.oracle_miou)
    assert got['regions_per_scene'] == 3


def test_metric_uses_objects_and_names_what_is_missing():
    scene = sample(np.random.default_rng(1))
    metric = OversegMetric()
    metric.dataset_meta = {'classes': ('a', 'b')}
    metric.process(None, [scene | {'pts_instance_mask': scene['pred_pts_region_mask']}])
    assert metric.evaluate(1)['boundary_f1'] == 100
    del scene['pred_pts_region_mask']
    with pytest.raises(SceneError, match="no .'pred_pts_region_mask'."):
        metric.process(None, [scene])
    with pytest.raises(ValueError, match='pass num_classes'):
        OversegMetric().process(None, [sample(np.random.default_rng(1))])


@pytest.mark.parametrize('kind', ['int8', 'uint8', 'uint16', 'int32', 'uint64'])
def test_any_integer_type_counts_alike(kind):
    rng = np.random.default_rng(5)
    xyz, classes, regions = rng.random((200, 3)), rng.integers(0, 4, 200), rng.integers(0, 30, 200)
    classes[:20] = 255 if kind != 'int8' else -1
    want = boundary_counts(xyz, classes, regions, 4, regions)
    got = boundary_counts(xyz, classes.astype(kind), regions.astype(kind), 4, regions.astype(kind))
    np.testing.assert_array_equal(got.confusion, want.confusion)
    names = ('true_edges', 'recalled', 'region_edges', 'confirmed', 'regions')
    assert [getattr(got, name) for name in names] == [getattr(want, name) for name in names]


def test_hashes_are_numbers_and_255_is_a_class_where_there_are_as_many():
    rng = np.random.default_rng(5)
    xyz, classes, regions = rng.random((100, 3)), rng.integers(0, 300, 100), rng.integers(0, 9, 100)
    classes[:9] = 255
    want = boundary_counts(xyz, classes, regions, 300)
    hashes = regions.astype(np.uint64) + np.uint64(2**64 - 9)
    got = boundary_counts(xyz, classes.astype(np.uint16), hashes, 300)
    assert got.regions == 9 and (got.true_edges, got.region_edges) == (want.true_edges, want.region_edges)
    np.testing.assert_array_equal(got.confusion, want.confusion)
    assert got.confusion[255].sum() == (classes == 255).sum() and got.confusion.sum() == 100


def test_what_has_no_object_is_the_stuff_of_its_class():
    xyz = np.arange(6.0)[:, None] * [1, 0, 0]
    classes = np.array([0, 0, 1, 1, 1, 1])
    counts = boundary_counts(xyz, classes, classes, 2, objects=np.array([-1, -1, -1, -1, 7, 7]), neighbors=1)
    assert counts.true_edges == 2  # floor to wall, and wall to picture
    assert boundary_counts(xyz, classes, classes, 2, objects=np.full(6, -1), neighbors=1).true_edges == 1
