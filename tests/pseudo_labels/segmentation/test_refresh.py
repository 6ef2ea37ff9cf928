"""One scene in, labels out: a small street with three cars, a person, a wall and ground."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pseudo_labels import refreshing

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.rotated_iou import rotated_iou_bev
from rm3d_plugin.pseudo_labels import (
    AnnotatedLabels,
    DetectionRules,
    ObjectKnowledge,
    ObjectRules,
    PropagationRules,
    RoundContext,
    SegmentationRules,
    refresh_detection,
)
from rm3d_plugin.regions import MergeRules, Reason
from rm3d_plugin.structures import Boxes3D, PointCloud, RegionGraph, Regions

SIZES = np.array([[3.9, 1.6, 1.56], [0.8, 0.6, 1.73]])
BACKGROUND = 2
TRUE = Boxes3D(
    np.array(
        [
            [10.0, 4, 0.78, *SIZES[0], 0.2],
            [20.0, -5, 0.78, *SIZES[0], -0.4],
            [30.0, 6, 0.78, *SIZES[0], 0.0],
            [12.0, -3, 0.865, *SIZES[1], 0.5],
        ]
    ),
    np.array([0, 0, 0, 1]),
)
COUNTS = np.array([3, 1])
MERGE = MergeRules(seed_share=0.0)


def surface(box, rng, n):
    """Points on the two sides of a box that look at the origin, 5 cm inside."""
    local = rng.uniform(-0.5, 0.5, (n, 3))
    c, s = np.cos(box[6]), np.sin(box[6])
    towards = np.array([[c, s], [-s, c]]) @ -box[:2]
    side = rng.random(n) < 0.5
    local[side, 0], local[~side, 1] = np.sign(towards) * 0.5
    local *= box[3:6] - 0.1
    return np.c_[local[:, 0] * c - local[:, 1] * s, local[:, 0] * s + local[:, 1] * c, local[:, 2]] + box[:3]


class Street:
    """Points, their true class and object, and regions: two halves of each object, wall, ground in no region."""

    def __init__(self, seed=0):
        rng = np.random.default_rng(seed)
        parts = [surface(box, rng, 120) for box in TRUE.tensor]
        wall = np.c_[rng.uniform(5, 35, 300), np.full(300, 15.0), rng.uniform(0, 4, 300)]
        bush = rng.uniform(-0.4, 0.4, (80, 3)) + [25, 2, 0.6]
        ground = np.c_[rng.uniform(5, 35, (200, 2)) * [1, 0.4], np.full(200, 0.01)]
        ground = ground[points_in_boxes(ground, TRUE.tensor, 0.4) < 0]
        self.xyz = np.concatenate([*parts, wall, bush, ground])
        sizes = [len(p) for p in (*parts, wall, bush, ground)]
        self.part = np.repeat(np.arange(7), sizes)
        self.truth = np.array([0, 0, 0, 1, 2, 2, 2])[self.part]
        half = np.array([self.xyz[self.part == p, 2].mean() for p in range(7)])[self.part] < self.xyz[:, 2]
        labels = np.where(self.part < 4, 2 * self.part + half, self.part + 4)
        self.shuffle(np.where(self.part == 6, -1, labels))

    def shuffle(self, labels, order=None):
        order = np.arange(len(labels)) if order is None else order
        self.xyz, self.part, self.truth = self.xyz[order], self.part[order], self.truth[order]
        self.cloud = PointCloud(self.xyz, sensor=(0.0, 0.0, 0.0))
        self.regions = Regions(labels[order])
        self.height = self.xyz[:, 2].copy()
        r = len(self.regions)
        centroids = self.regions.pool_mean(self.xyz)
        gap = np.linalg.norm(centroids[:, None] - centroids[None], axis=2)
        self.graph = RegionGraph(
            centroids=centroids,
            normals=np.tile([0.0, 0, 1], (r, 1)),
            curvatures=centroids[:, 0] / 1000,
            descriptors=np.ones((r, 2)),
            colors=None,
            extents=np.ones((r, 3)),
            sizes=self.regions.sizes,
            edges=np.argwhere(np.triu(gap < 4, 1)),
        )

    def annotated(self, *rows, complete=False):
        unknown = np.full(len(self.xyz), -1)
        return AnnotatedLabels(unknown, unknown.copy(), TRUE.select(np.array(rows, dtype=np.int64)), complete)

    def softmax(self, peak=0.9):
        rows = np.full((len(self.xyz), 3), (1 - peak) / 2)
        rows[np.arange(len(rows)), self.truth] = peak
        return rows

    def centers(self):
        middle = np.r_[TRUE.tensor[:, :3], np.zeros((3, 3))][self.part]
        return np.where((self.part < 4)[:, None], middle, self.xyz)

    def refresh(
        self, annotated, rows=None, centers=None, previous=None, rules=MERGE, round=4, objects=None, sizes=SIZES
    ):
        scene = refreshing.inputs(self, annotated, rows, centers, previous)
        context = RoundContext(round, DetectionRules(rules, objects or ObjectRules()), COUNTS)
        return refresh_detection(scene, context, ObjectKnowledge(sizes, self.height))


@pytest.fixture
def street():
    return Street()


def test_round_0_labels_annotated_boxes_and_what_geometry_knows(street):
    result = street.refresh(street.annotated(1), round=0)
    labels = result.labels
    inside = points_in_boxes(street.xyz, TRUE.tensor[1:2]) >= 0
    assert (labels.semantic[inside] == 0).all() and (labels.instance[inside] == 0).all()
    assert labels.point_is_annotated.tolist() == inside.tolist()
    assert (labels.confidence[inside] == 1).all()
    wall_or_ground = np.isin(street.part, [4, 6])
    assert (labels.semantic[wall_or_ground] == BACKGROUND).all()
    assert (labels.confidence[wall_or_ground] < 1).all()
    others = np.isin(street.part, [0, 2, 3, 5])
    assert (labels.semantic[others] == -1).all()
    assert labels.box_is_annotated.tolist() == [True]
    np.testing.assert_array_equal(labels.boxes.tensor, TRUE.tensor[1:2])


def test_an_empty_budget_still_gives_background(street):
    labels = street.refresh(street.annotated(), round=0).labels
    assert set(labels.semantic.tolist()) == {-1, BACKGROUND}
    assert len(labels.boxes) == 0 and not labels.point_is_annotated.any()


def test_confident_predictions_become_boxes_at_the_right_place(street):
    result = street.refresh(street.annotated(1), street.softmax(), street.centers())
    labels = result.labels
    assert labels.box_is_annotated.tolist() == [True, False, False, False]
    iou = rotated_iou_bev(TRUE.tensor, labels.boxes.tensor)
    assert iou[1, 0] == pytest.approx(1)
    assert (iou.max(axis=1)[[0, 2]] > 0.8).all() and iou[3].max() > 0.4
    assert (labels.boxes.labels[iou.argmax(axis=1)] == TRUE.labels).all()
    assert (labels.semantic == street.truth).mean() > 0.99
    for part in range(4):
        assert set(labels.instance[street.part == part].tolist()) == {int(iou[part].argmax())}
    assert (labels.instance[street.part >= 4] == -1).all()
    assert result.stats['pseudo_boxes'] == 3 and result.stats['coverage'] == labels.coverage


def test_doubt_labels_nothing(street):
    labels = street.refresh(street.annotated(), street.softmax(0.7), street.centers()).labels
    assert (labels.semantic[street.part < 4] == -1).all()
    assert len(labels.boxes) == 0


def test_unseen_points_do_not_count(street):
    rows = street.softmax()
    rows[::2] = np.nan
    rows[1::4] = 0
    labels = street.refresh(street.annotated(), rows, street.centers()).labels
    assert (labels.semantic == street.truth).mean() > 0.99
    assert len(labels.boxes) == 4


def test_annotated_boxes_always_win(street):
    wrong = street.softmax()
    wrong[street.part == 1] = [0.02, 0.96, 0.02]  # the annotated car is taken for a person
    labels = street.refresh(street.annotated(1), wrong, street.centers()).labels
    assert (labels.semantic[street.part == 1] == 0).all()
    assert not ((labels.boxes.labels == 1) & (np.hypot(*(labels.boxes.tensor[:, :2] - TRUE.tensor[1, :2]).T) < 3)).any()


def test_what_lies_around_an_annotated_box_is_background(street):
    near = TRUE.tensor[1].copy()
    moved = Boxes3D(near[None] + [0, 0, 0, -0.4, -0.4, 0, 0], np.array([0]))  # the box now leaves its sides outside
    annotated = replace(street.annotated(), boxes=moved)
    labels = street.refresh(annotated, street.softmax(), street.centers()).labels
    outside = (street.part == 1) & (points_in_boxes(street.xyz, moved.tensor) < 0)
    assert outside.sum() > 50
    assert (labels.semantic[outside] == BACKGROUND).all()
    assert not labels.point_is_annotated[outside].any()


def test_a_complete_scene_has_no_unknown_point(street):
    labels = street.refresh(street.annotated(0, 1, 2, 3, complete=True), round=0).labels
    assert labels.complete and labels.point_is_annotated.all() and labels.coverage == 1
    assert (labels.semantic == street.truth).all()


def test_labels_are_permanent_or_demoted(street):
    first = street.refresh(street.annotated(1), street.softmax(), street.centers(), round=1).labels
    doubt = street.softmax(0.4)
    kept = street.refresh(street.annotated(1), doubt, street.centers(), first, round=2).labels
    assert (kept.semantic == first.semantic).all()
    assert len(kept.boxes) == len(first.boxes)
    demoting = replace(MERGE, demote_margin=0.15)
    lost = street.refresh(street.annotated(1), doubt, street.centers(), first, demoting, 2).labels
    assert (lost.semantic[np.isin(street.part, [0, 2, 3])] == -1).all()
    assert lost.box_is_annotated.tolist() == [True]
    held = street.refresh(street.annotated(1), street.softmax(0.65), street.centers(), first, demoting, 2).labels
    assert (held.semantic == first.semantic).all() and len(held.boxes) == len(first.boxes)


def test_a_group_of_two_objects_is_split_by_its_votes(street):
    street.shuffle(np.where(street.part < 2, 0, np.where(street.part == 6, -1, street.part)))
    zero = street.refresh(street.annotated(), round=0).labels
    assert (zero.semantic[street.part < 2] == BACKGROUND).all()  # far too large for a car
    without = street.refresh(street.annotated(), street.softmax(), previous=zero).labels
    assert (without.semantic[street.part < 2] == BACKGROUND).all()
    split = street.refresh(street.annotated(), street.softmax(), street.centers(), without).labels
    assert (split.semantic[street.part < 2] == 0).mean() > 0.95
    assert (rotated_iou_bev(TRUE.tensor[:2], split.boxes.tensor).max(axis=1) > 0.8).all()


def test_rules_and_errors(street):
    strict = street.refresh(street.annotated(), street.softmax(), street.centers(), objects=ObjectRules(min_points=500))
    assert len(strict.labels.boxes) == 0 and strict.stats['small_groups'] == 4
    with pytest.raises(ValueError, match=r'ObjectRules\.min_points'):
        ObjectRules(min_points=0)
    with pytest.raises(ValueError, match='probabilities has 5 rows'):
        street.refresh(street.annotated(), np.zeros((5, 3)))
    with pytest.raises(ValueError, match='annotated has 2 rows'):
        street.refresh(AnnotatedLabels.nothing(2))
    with pytest.raises(ValueError, match=r'probabilities have shape \(\d+, 2\), expected \(\d+, 3\)'):
        street.refresh(street.annotated(), street.softmax()[:, :2])


def test_classes_without_a_size_get_no_box(street):
    sizes = SIZES.copy()
    sizes[1] = np.nan
    labels = street.refresh(street.annotated(), street.softmax(), sizes=sizes).labels
    assert set(labels.boxes.labels.tolist()) == {0}
    assert (labels.semantic[street.part == 3] == 1).all()


@pytest.mark.parametrize('n', [0, 1])
def test_tiny_scenes(n):
    nothing = np.zeros((n, 3))
    regions = Regions(np.zeros(n, dtype=np.int64))
    graph = RegionGraph(
        nothing, nothing, np.zeros(n), np.zeros((n, 2)), None, nothing, np.ones(n, int), np.zeros((0, 2), int)
    )
    scene = refreshing.inputs(
        SimpleNamespace(cloud=PointCloud(nothing), regions=regions, graph=graph), AnnotatedLabels.nothing(n)
    )
    context = RoundContext(0, DetectionRules(MERGE), COUNTS)
    assert len(refresh_detection(scene, context, ObjectKnowledge(SIZES, np.zeros(n))).labels) == n
    assert len(refreshing.points(scene, MERGE, 0, COUNTS).labels) == n


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 1000))
def test_permuting_points_permutes_labels(seed):
    a, b = Street(seed % 3), Street(seed % 3)
    order = np.random.default_rng(seed).permutation(len(a.xyz))
    b.shuffle(np.asarray(b.regions.labels), order)
    one = a.refresh(a.annotated(1), a.softmax(), a.centers()).labels
    two = b.refresh(b.annotated(1), b.softmax(), b.centers()).labels
    np.testing.assert_array_equal(one.semantic[order], two.semantic)
    np.testing.assert_array_equal(one.instance[order] >= 0, two.instance >= 0)
    # Boxes are numbered by region, regions by first point; their places are the same.
    own = one.instance[order] >= 0
    np.testing.assert_allclose(
        one.boxes.tensor[one.instance[order][own], :3], two.boxes.tensor[two.instance[own], :3], atol=1e-6
    )


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 1000))
def test_coverage_never_falls_while_labels_are_permanent(seed):
    street, rng = Street(), np.random.default_rng(seed)
    annotated = street.annotated(int(rng.integers(4)))
    previous, boxes_of_truth = None, None
    for round in range(5):
        rows = rng.dirichlet(np.full(3, 0.2), len(street.regions) + 1)[street.regions.labels]
        labels = street.refresh(annotated, rows if round else None, None, previous, round=round).labels
        if previous is not None:
            assert labels.coverage >= previous.coverage
            given_before = previous.semantic >= 0
            changed = given_before & (labels.semantic != previous.semantic)
            assert (previous.semantic[changed] == BACKGROUND).all()  # only what was too large for an object
            assert (street.part[changed] == 4).all()
            np.testing.assert_array_equal(labels.boxes.tensor[labels.box_is_annotated], boxes_of_truth)
        boxes_of_truth = labels.boxes.tensor[labels.box_is_annotated]
        assert (labels.confidence[labels.semantic < 0] == 0).all()
        assert (labels.instance < len(labels.boxes)).all()
        own = labels.instance >= 0
        assert (labels.boxes.labels[labels.instance[own]] == labels.semantic[own]).all()
        previous = labels


def segmentation(street, rows=None, previous=None, round=4, seeds=((0, 0, 5), (3, 1, 2)), rules=MERGE):
    semantic, instance = np.full(len(street.xyz), -1), np.full(len(street.xyz), -1)
    for part, label, number in seeds:
        first = np.flatnonzero(street.part == part)[0]
        semantic[first], instance[first] = label, number
    annotated = AnnotatedLabels(semantic, instance, Boxes3D.empty())
    counts = np.array([3, 1, 9])
    scene = refreshing.inputs(street, annotated, rows, previous=previous)
    return refreshing.points(scene, rules, round, counts, (0, 1))


def test_one_point_labels_its_region_and_with_confidence_its_group(street):
    zero = segmentation(street, round=0).labels
    region = street.regions.labels[np.flatnonzero(street.part == 0)[0]]
    assert set(zero.semantic[street.regions.labels == region].tolist()) == {0}
    assert set(zero.instance[street.regions.labels == region].tolist()) == {5}
    assert int(zero.point_is_annotated.sum()) == 2
    later = segmentation(street, street.softmax(), zero)
    labels = later.labels
    assert (labels.semantic[street.part != 6] == street.truth[street.part != 6]).all()
    assert (labels.semantic[street.part == 6] == -1).all()
    assert set(labels.instance[street.part == 0].tolist()) == {5}
    assert set(labels.instance[street.part == 3].tolist()) == {2}
    fresh = set(labels.instance[np.isin(street.part, [1, 2])].tolist())
    assert len(fresh) == 2 and min(fresh) > 5
    assert (labels.instance[street.part == 4] == -1).all()
    assert later.merge.ledger.reason.max() <= Reason.SAME_GROUP


def test_groups_without_an_annotated_instance_may_stay_without_one(street):
    usual = segmentation(street, street.softmax()).labels
    labels = segmentation(
        street, street.softmax(), rules=SegmentationRules(MERGE, PropagationRules(new_instances=False))
    ).labels
    assert (labels.semantic == usual.semantic).all()
    assert set(labels.instance[street.part == 0].tolist()) == {5}
    fresh = np.isin(street.part, [1, 2])
    assert (usual.instance[fresh] > 5).all() and (labels.instance[fresh] == -1).all()
    assert (labels.instance[~fresh] == usual.instance[~fresh]).all()


def test_two_labelled_instances_stay_two(street):
    # Both halves of one car carry a label of another instance: an error in the labels, yet never one group.
    semantic, instance = np.full(len(street.xyz), -1), np.full(len(street.xyz), -1)
    halves = np.unique(street.regions.labels[street.part == 0]).tolist()
    for number, region in enumerate(halves):
        semantic[street.regions.points_of(region)[0]], instance[street.regions.points_of(region)[0]] = 0, number
    annotated = AnnotatedLabels(semantic, instance, Boxes3D.empty())
    out = refreshing.points(refreshing.inputs(street, annotated, street.softmax()), MERGE, 4, np.ones(3, int), (0,))
    assert out.merge.group[halves[0]] != out.merge.group[halves[1]]
    for number, region in enumerate(halves):
        assert set(out.labels.instance[street.regions.labels == region].tolist()) == {number}
