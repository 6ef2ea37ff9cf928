"""Looks of regions to a sensor by hand, and what clicked regions teach of the others."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels.region_graphs import make_graph

from rm3d_plugin.pseudo_labels import RegionPriorRules
from rm3d_plugin.pseudo_labels.common.distance_prior import annotated_distances, distance_prior
from rm3d_plugin.pseudo_labels.common.kernel_classifier import class_prior_em
from rm3d_plugin.pseudo_labels.common.sensor import IntensityByRange
from rm3d_plugin.pseudo_labels.region_prior import classifier as region_knowledge
from rm3d_plugin.pseudo_labels.region_prior.classifier import RegionCollector, RegionKnowledge, region_rows
from rm3d_plugin.pseudo_labels.region_prior.features import (
    DESCRIPTOR_WEIGHT,
    SHAPE_COLUMNS,
    RegionExamples,
    prior_features,
)
from rm3d_plugin.pseudo_labels.region_prior.prior import region_prior
from rm3d_plugin.pseudo_labels.region_prior.statistics import region_statistics
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import PointCloud, Regions

WALL, BUSH, POST = range(3)
RULES = RegionPriorRules(classifier='kernel', distance_scale=1.0, heading=True)


def thing(kind, place, rng):
    """Points, return strengths and extents of a wall, a bush or a post."""
    count = [60, 40, 15][kind]
    size = np.array([[4.0, 0.1, 2.0], [1.0, 1.0, 1.0], [0.1, 0.1, 2.0]])[kind]
    xyz = place + rng.uniform(-0.5, 0.5, (count, 3)) * size
    strength = np.array([0.3, 0.5, 0.6])[kind] * 10 / np.linalg.norm(place) * rng.normal(1, 0.15, count)
    return xyz, strength, np.sort(size)[::-1]


def street(seed, counts=(12, 5, 3)):
    """A scene of many walls and few posts, each a region, and one click a class."""
    rng = np.random.default_rng(seed)
    kinds = np.repeat([WALL, BUSH, POST], counts)
    places = np.c_[
        rng.uniform(-20, 20, len(kinds)), rng.choice([-1, 1], len(kinds)) * (8 - kinds), np.zeros(len(kinds))
    ]
    things = [thing(kind, place, rng) for kind, place in zip(kinds, places, strict=True)]
    xyz, strength = (np.concatenate([one[i] for one in things]) for i in (0, 1))
    regions = Regions(np.repeat(np.arange(len(kinds)), [len(one[0]) for one in things]))
    graph = make_graph(len(kinds), descriptors=np.eye(3)[kinds] + 0.5 * rng.normal(size=(len(kinds), 3)))
    upright = np.tile([1.0, 0, 0], (len(kinds), 1))
    extents = np.stack([one[2] for one in things])
    graph = replace(graph, extents=extents, normals=upright, sizes=np.array(regions.sizes))
    scene = PreparedScene(PointCloud(xyz, intensity=strength, sensor=(0.0, 0.0, 0.0)), regions, graph)
    truth = np.full(len(xyz), -1)
    for kind in np.unique(kinds):
        truth[rng.choice(np.flatnonzero(kinds[regions.labels] == kind))] = kind
    return scene, truth, kinds


def test_columns_by_hand():
    scene, _, _ = street(0)
    rows = region_rows(scene, True)
    usual = IntensityByRange(np.array([5.0, 25.0]), np.array([0.5, 0.1]))
    columns = rows.columns(usual)
    features = prior_features(scene.cloud, scene.regions, scene.graph)
    np.testing.assert_array_equal(columns[:, : features.shape[1]], features)
    for region in range(len(scene.regions)):
        members = scene.regions.points_of(region)
        middle = scene.cloud.xyz[members].astype(float).mean(axis=0)
        away, strength = np.linalg.norm(middle), scene.cloud.intensity[members].astype(float)
        there = np.interp(away, [5.0, 25.0], [0.5, 0.1])
        area = np.prod(np.sort(scene.graph.extents[region])[1:])
        wanted = [
            strength.mean() / there,
            strength.std() / there,
            np.log(len(members) * away**2 / max(area, 0.01)),
            np.log(len(members) * away**2),
            np.log(away),
            abs(middle[1]),
        ]
        np.testing.assert_allclose(columns[region, features.shape[1] :], wanted, rtol=1e-5)


def test_what_is_not_known_is_left_out():
    scene, _, _ = street(0)
    blind = replace(scene, cloud=replace(scene.cloud, intensity=None))
    lost = replace(scene, cloud=replace(scene.cloud, sensor=None))
    usual, count = (
        IntensityByRange(np.array([1.0]), np.array([0.5])),
        prior_features(scene.cloud, scene.regions, scene.graph).shape[1],
    )
    assert (region_rows(blind, True).columns(usual)[:, count : count + 2] == 0).all()
    assert (region_rows(lost, True).columns(usual)[:, count + 2 :] == 0).all()
    assert (region_rows(scene, False).columns(usual)[:, -1] == 0).all()


def known_of(streets, rules=RULES, min_upright=None):
    return region_statistics(((scene, truth) for scene, truth, _ in streets), 4, rules, None, min_upright)


def test_clicked_regions_of_all_scenes_name_the_others():
    streets = [street(seed) for seed in range(8)]
    statistics = known_of(streets)
    right = []
    for scene, truth, kinds in streets:
        prior = region_prior(scene, truth, statistics.lengths, statistics.known, RULES)
        places = distance_prior(annotated_distances(scene.cloud.xyz, scene.regions, truth, 4), statistics.lengths, 1.0)
        product = places * statistics.known.shares(scene)
        np.testing.assert_allclose(prior, product / product.sum(axis=1, keepdims=True))
        right.append(prior.argmax(axis=1) == kinds)
    assert np.mean(right) > 0.9
    shares = statistics.known.shares(streets[0][0])
    assert shares[:, :3].sum(axis=1) == pytest.approx(1.0)
    assert (shares[:, 3] == region_knowledge.DOUBT).all()  # a class that no region teaches
    points = np.array([12 * 60, 5 * 40, 3 * 15, 0])
    assert statistics.known.frequencies == pytest.approx(points / points.sum(), abs=0.05)


def test_frequencies_and_scaling_are_those_of_the_scenes():
    streets = [street(seed) for seed in range(5)]
    statistics = known_of(streets)
    rows = [region_rows(scene, True) for scene, _, _ in streets]
    columns = np.concatenate([part.columns(statistics.known.usual) for part in rows])
    sizes = np.concatenate([part.sizes for part in rows])
    large = columns[sizes >= 30]
    np.testing.assert_allclose(statistics.known.classes.scaling.middle, large.mean(axis=0), rtol=1e-6)
    weights = statistics.known.classes.scaling.weights
    told = large.std(axis=0) > 1e-6
    raw = np.r_[[1 / SHAPE_COLUMNS] * SHAPE_COLUMNS, [DESCRIPTOR_WEIGHT / 3] * 3, [1 / SHAPE_COLUMNS] * 6] * told
    np.testing.assert_allclose(weights, raw / raw.sum())
    distance = [annotated_distances(s.cloud.xyz, s.regions, truth, 4) for s, truth, _ in streets]
    near = np.concatenate([distance_prior(one, statistics.lengths, 1.0) for one in distance])
    wanted = class_prior_em(statistics.known.classes.shares(columns, 4) * near, sizes, near > 0)
    np.testing.assert_allclose(statistics.known.frequencies, wanted)


def test_level_regions_teach_but_do_not_count():
    streets = [street(seed) for seed in range(6)]
    for scene, _, kinds in streets:
        scene.graph.normals[kinds == WALL] = [0.0, 0.0, 1.0]  # lying walls
    statistics = known_of(streets, min_upright=0.9)
    assert WALL in statistics.known.classes.classes
    assert statistics.known.frequencies[WALL] < 0.2 < known_of(streets).known.frequencies[WALL]


def test_many_scenes_are_stood_for_by_some(monkeypatch):
    monkeypatch.setattr(region_knowledge, 'MOST_SCENES', 3)
    collector = RegionCollector(True, None)
    streets = [street(seed) for seed in range(9)]
    for scene, truth, kinds in streets:
        collector.add(scene, np.where(np.arange(len(kinds)) < 3, kinds, -1), truth, 4)
    kept = [scene.rows.ranges[0] for scene in collector._scenes]
    assert kept == [region_rows(streets[i][0], True).ranges[0] for i in (0, 4, 8)]
    assert len(collector.learn(np.full(4, np.nan), 1.0).classes.rows) == 9 * 3


def test_examples_beyond_what_fits_are_thinned_class_by_class(monkeypatch):
    monkeypatch.setattr(region_knowledge, 'MOST_GATHERED', 30)
    monkeypatch.setattr(region_knowledge, 'MOST_EXAMPLES', 4)
    collector = RegionCollector(True, None)
    for seed in range(12):
        scene, truth, kinds = street(seed)
        collector.add(scene, np.where(np.isin(np.arange(len(kinds)), [0, 12, 17]), kinds, -1), truth, 4)
        assert sum(map(len, collector._classes)) <= 30
    known = collector.learn(np.full(4, np.nan), 1.0)
    assert len(known.classes.rows) == 3 * 4 and known.classes.classes.tolist() == [WALL, BUSH, POST]


def test_nothing_clicked_and_no_region():
    scene, truth, _ = street(0)
    assert known_of([(scene, np.full_like(truth, -1), None)]).known is None
    empty = PreparedScene(PointCloud(np.zeros((3, 3))), Regions(np.full(3, -1)), make_graph(0))
    assert known_of([(empty, np.array([0, -1, 1]), None)]).known is None


def test_few_clicked_regions_vote():
    streets = [street(seed) for seed in range(5)]
    assert isinstance(known_of(streets).known, RegionKnowledge)  # three clicked regions each
    few = known_of(streets[:4]).known
    plain = known_of(streets[:4], replace(RULES, classifier='neighbors')).known
    assert isinstance(few, RegionExamples)
    np.testing.assert_array_equal(few.features, plain.features)
