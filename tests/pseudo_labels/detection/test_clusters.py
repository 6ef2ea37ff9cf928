"""Clusters above the ground: which points, what they look like, and how like annotated objects they are."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.detection.clusters import (
    LEAST,
    SLABS,
    ObjectClusters,
    cluster_of_boxes,
    described,
    fit_likeness,
    known_mean,
    like_clusters,
    looks_like_its_class,
    named_clusters,
    object_clusters,
    shapes,
    unlike_clusters,
)
from rm3d_plugin.structures import Boxes3D, Descriptors, PointCloud

SIZES = np.array([[4.0, 2.0, 1.5], [0.8, 0.6, 1.8], [np.nan] * 3])


def block(x, y, size, rng, count=200):
    return rng.uniform([x, y, 0.3], [x + size[0], y + size[1], size[2]], size=(count, 3))


def test_clusters_are_what_stands_apart_above_the_ground():
    rng = np.random.default_rng(0)
    car, person = block(5, 0, (4, 2, 1.5), rng, 3000), block(5, 2.6, (0.5, 0.5, 1.7), rng)
    strays = np.full((LEAST - 1, 3), 50.0)
    pole = np.c_[np.full(60, 20.0), np.zeros(60), np.linspace(0.3, 6.0, 60)]
    strays[:, 2] = 1.0
    floor = np.c_[rng.uniform(0, 30, size=(300, 2)), np.zeros(300)]
    xyz = np.concatenate([car, person, pole, strays, floor])
    got = object_clusters(xyz, xyz[:, 2], xyz[:, 2] < 0.1, SIZES)
    assert set(got[:3000]) == {0} and set(got[3000:3200]) == {1}
    on_pole = xyz[3200:3260, 2] < 1.5 * 1.8
    assert (got[3200:3260][on_pole] == 2).all() and (got[3200:3260][~on_pole] == -1).all()
    assert (got[3260:] == -1).all()
    assert (object_clusters(xyz, xyz[:, 2], xyz[:, 2] < 0.1, SIZES[2:]) == -1).all()


def test_shapes_by_hand():
    xyz = np.array([[10.0, -1, 0.2], [10, 1, 0.2], [10, 0, 1.0], [10, 0, 1.9], [30, 0, 0.5]])
    cloud = PointCloud(xyz, intensity=np.array([0.0, 0.2, 0.4, 0.6, 1.0]), sensor=(0.0, 0.0, 0.0))
    got = shapes(cloud, xyz[:, 2], np.array([0, 0, 0, 0, -1]), 2, tall=2.0)
    assert got.shape == (2, 7 + 3 * SLABS + 3) and not got[1].any()
    top, low, long, short, sd_long, sd_short, many = got[0, :7]
    assert (top, low) == pytest.approx((1.9, 0.2)) and (long, short) == pytest.approx((2.0, 0.0))
    assert sd_long == pytest.approx(np.sqrt(0.5)) and sd_short == pytest.approx(0.0, abs=1e-7)
    assert many == pytest.approx(np.log1p(4 * ((10 + np.sqrt(101)) / 2 / 10) ** 2))
    slabs = got[0, 7:-3].reshape(SLABS, 3)
    assert slabs[:, 0].tolist() == [0.5, 0.0, 0.25, 0.0, 0.25] and slabs[:, 1] == pytest.approx([2.0, 0, 0, 0, 0])
    assert got[0, -3:] == pytest.approx([0.3, np.std([0, 0.2, 0.4, 0.6]), np.quantile([0, 0.2, 0.4, 0.6], 0.9)])


def test_where_nobody_knows_the_sensor_points_count_as_they_are():
    xyz = np.random.default_rng(4).uniform(20, 21, size=(30, 3))
    owner = np.zeros(30, dtype=int)
    far, unknown = (shapes(PointCloud(xyz, sensor=at), xyz[:, 2], owner, 1, 1.8) for at in ((0.0, 0.0, 0.0), None))
    assert unknown[0, 6] == pytest.approx(np.log1p(30)) and far[0, 6] > unknown[0, 6] + 2


def test_shapes_do_not_ask_which_way_something_is_turned():
    rng = np.random.default_rng(1)
    xyz = block(8, -1, (4, 1.5, 1.6), rng)
    angle = 0.9
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    colors = rng.uniform(size=(200, 3))
    owner = np.zeros(200, dtype=int)
    one, other = (
        shapes(PointCloud(points, colors=colors, sensor=(0.0, 0.0, 0.0)), xyz[:, 2], owner, 1, 1.8)
        for points in (xyz, xyz @ turn.T)
    )
    assert one.shape[1] == 7 + 3 * SLABS + 9 and other == pytest.approx(one, abs=1e-4)


def test_what_is_shaped_like_annotated_objects_is_like_them():
    rng = np.random.default_rng(2)
    clutter, people = rng.normal(0.0, 1.0, size=(300, 6)), rng.normal(3.0, 0.4, size=(40, 6))
    cars = rng.normal(-3.0, 0.4, size=(40, 6))
    annotated, labels = np.concatenate([people[:4], cars[:4]]), np.repeat([1, 0], 4)
    likeness, left_out = fit_likeness(annotated, labels, np.concatenate([clutter, people, cars]), 3)
    told = likeness.of(np.concatenate([people[4:], cars[4:], clutter]))
    assert (told[:36, 1] > 0.5).mean() > 0.9 and (told[36:72, 0] > 0.5).mean() > 0.9
    assert (told[72:, :2] < 0.3).mean() > 0.95 and told[:36, 0].max() < 0.3
    assert np.isnan(told[:, 2]).all()  # nobody annotated one
    for c in (0, 1):
        assert np.median(left_out[labels == c]) == pytest.approx(1.0)


@pytest.mark.parametrize(('objects', 'clusters'), [(0, 20), (1, 20), (3, 0)])
def test_from_one_object_or_no_cluster_nobody_knows_what_is_usual(objects, clusters):
    rows = np.random.default_rng(3).normal(size=(20, 5))
    likeness, left_out = fit_likeness(rows[:objects], np.ones(objects, dtype=int), rows[:clusters], 2)
    assert not likeness.known.any() and not left_out.any()
    assert np.isnan(likeness.of(rows)).all() and likeness.of(rows[:0]).shape == (0, 2)


POINT = np.array([0, 0, 0, 1, 1, -1, 2])
CLUSTERS = ObjectClusters(POINT, np.array([[2.0, 0.1], [0.5, 0.4], [0.1, 0.2]]), np.zeros(0))


def test_what_descriptors_say_of_clusters():
    values = np.array([[1.0, 0], [3, 2], [5, 5], [0, 0], [7, 7]], dtype=np.float32)
    descriptors = Descriptors(values, np.array([True, True, True, False, True]))
    got = described(descriptors, np.array([0, 0, 2, 1, -1]), 4)
    assert got[[0, 2]].tolist() == [[2.0, 1.0], [5.0, 5.0]]
    assert np.isnan(got[[1, 3]]).all()  # not described, and without a point
    picked = descriptors.select(np.array([2, 0]))
    assert described(picked, np.zeros(2, dtype=int), 1).tolist() == [[3.0, 2.5]]


def test_likenesses_are_pooled_where_they_are_known():
    got = known_mean([np.array([[4.0, 4.0], [np.nan, 0.0]]), np.array([[1.0, np.nan], [np.nan, 3.0]])])
    assert got[0].tolist() == [2.5, 4.0] and got[1, 1] == 1.5 and np.isnan(got[1, 0])


def test_clusters_are_named_by_network_and_shape():
    rows = np.array([[0.6, 0.4, 0.0]] * 3 + [[0.2, 0.6, 0.2], [np.nan] * 3, [1.0, 0, 0], [0.0, 0.0, 1.0]])
    got = named_clusters(CLUSTERS, rows)
    assert got.point.tolist() == [0, 0, 0, 1, 1, -1, -1]  # of the third both say nothing
    assert got.labels.tolist() == [0, 1]
    assert got.scores == pytest.approx([0.6 * 1.0, 0.3 * 0.4])  # likeness counts up to 1; unseen points count as 0
    nothing = named_clusters(ObjectClusters(np.full(7, -1), np.zeros((0, 2)), np.zeros(0)), rows)
    assert len(nothing.labels) == len(nothing.scores) == 0


def test_clusters_like_no_class():
    assert unlike_clusters(CLUSTERS, 0.3).tolist() == [False, False, True]
    assert not unlike_clusters(CLUSTERS, 0.0).any()
    unknown = CLUSTERS.likeness * [1.0, np.nan]  # of the second class nobody knows what its objects look like
    assert not unlike_clusters(CLUSTERS._replace(likeness=unknown), 1.0).any()
    assert named_clusters(CLUSTERS._replace(likeness=unknown), np.full((7, 3), 0.5)).labels.tolist() == [0, 0, 0]
    assert len(unlike_clusters(ObjectClusters(np.full(3, -1), np.zeros((0, 2)), np.zeros(0)), 1.0)) == 0


def test_clusters_like_a_class_and_their_points():
    like = like_clusters(CLUSTERS, 0.5)
    assert like.tolist() == [True, True, False] and like_clusters(CLUSTERS, 0.6).tolist() == [True, False, False]
    assert CLUSTERS.points_of(like).tolist() == [True, True, True, True, True, False, False]
    unknown = CLUSTERS._replace(likeness=CLUSTERS.likeness * [1.0, np.nan])
    assert like_clusters(unknown, 0.5).tolist() == [True, True, False]  # by the class that is known


def test_a_box_looks_as_the_cluster_of_most_of_its_points():
    xyz = np.array([[0.0, 0, 1], [0.1, 0, 1], [0.2, 0, 1], [0.3, 0, 1], [5, 0, 1], [9, 0, 1], [0.4, 0, 1]])
    tensor = np.array([[x, 0, 1, 1.5, 1, 2, 0.0] for x in (0.0, 5.0, 9.0)] + [[0.4, 0, 1, 0.1, 1, 2, 0.0]])
    first, second = (Boxes3D(tensor, np.full(4, label), np.ones(4)) for label in (0, 1))
    assert cluster_of_boxes(CLUSTERS, xyz, first).tolist() == [0, 1, -1, 2]
    assert looks_like_its_class(CLUSTERS, xyz, first, 0.3).tolist() == [True, True, False, False]
    assert looks_like_its_class(CLUSTERS, xyz, first, 0.6).tolist() == [True, False, False, False]
    assert looks_like_its_class(CLUSTERS, xyz, second, 0.3).tolist() == [False, True, False, False]  # by its own class
    unknown = CLUSTERS._replace(likeness=CLUSTERS.likeness * [1.0, np.nan])
    assert looks_like_its_class(unknown, xyz, first, 0.6).tolist() == [True, False, False, False]
    assert looks_like_its_class(unknown, xyz, second, 0.6).all()
