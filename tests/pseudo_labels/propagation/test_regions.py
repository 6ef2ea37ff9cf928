from itertools import pairwise

import numpy as np
import pytest
from steps_scene import clicks, scene

from rm3d_plugin.pseudo_labels.propagation import prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.class_shares import (
    OTHERS,
    _own,
    class_shares,
    surest_regions,
    teaching_counts,
)
from rm3d_plugin.pseudo_labels.propagation.labels import Labels
from rm3d_plugin.pseudo_labels.propagation.left_out import strength_of
from rm3d_plugin.pseudo_labels.propagation.relax import relax
from rm3d_plugin.pseudo_labels.propagation.rules import DEFAULT, WalkerRules


def labels_of(semantic, each, prepared):
    points = np.flatnonzero(clicks(semantic, each) >= 0)
    return Labels.of(prepared, points, semantic[points], 3)


def test_scales_are_nested_partitions_with_the_means_of_their_points():
    cloud, _ = scene()
    scales = prepare_cloud(cloud).scales
    for finer, coarser in pairwise(scales):
        assert len(coarser.sizes) < len(finer.sizes)
        assert len(np.unique(np.stack([finer.region, coarser.region]), axis=1).T) == len(finer.sizes)
    for scale in scales:
        assert scale.sizes.sum() == len(cloud)
        own = scale.region == 3
        np.testing.assert_allclose(scale.mean(cloud.colors.astype(float))[3], cloud.colors[own].mean(axis=0), rtol=1e-6)


def test_features_of_labelled_regions_tell_classes_apart():
    cloud, semantic = scene()
    prepared = prepare_cloud(cloud)
    shares = class_shares(prepared, labels_of(semantic, 10, prepared), 200)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=1e-5)
    assert np.mean(shares.argmax(axis=1) == semantic) > 0.9


def test_a_right_answer_teaches():
    cloud, semantic = scene()
    prepared = prepare_cloud(cloud)
    labels = labels_of(semantic, 1, prepared)
    alone = class_shares(prepared, labels, 200)
    taught = class_shares(prepared, labels, 200, np.eye(3, dtype=np.float32)[semantic])
    right = [np.mean(each.argmax(axis=1) == semantic) for each in (alone, taught)]
    assert right[1] > max(right[0], 0.95)


def test_a_stroke_teaches_each_of_its_regions_once():
    cloud, semantic = scene()
    prepared = prepare_cloud(cloud)
    scale = prepared.scales[0]
    two = np.flatnonzero(scale.region == scale.region[100]), np.flatnonzero(scale.region == scale.region[2000])
    points = np.concatenate([*two, np.flatnonzero(semantic == 2)[:1]])
    classes = np.repeat([0, 2], [len(points) - 1, 1])
    labels = Labels(
        points, classes, 3, np.repeat([0, 1], [len(points) - 1, 1]), scale.region[points], *no_others(scale)
    )
    rows, said = _own(scale, labels, 200)
    assert len(points) > 5 and said.tolist() == [0, 0, 2]
    np.testing.assert_array_equal(
        rows, scale.features[[*np.sort(scale.region[points[[0, len(two[0])]]]), labels.regions[-1]]]
    )
    assert teaching_counts(labels).tolist() == [2, 0, 1] and labels.counts.tolist() == [len(points) - 1, 0, 1]
    lent = np.repeat(scale.features[:1], 300, axis=0)
    crowd = labels._replace(others=lent, other_classes=np.zeros(300, dtype=np.int64))
    assert teaching_counts(crowd).tolist() == [2 + OTHERS, 0, 1], 'no more of other scans than teach'
    assert np.bincount(_own(scale, crowd, 200)[1]).tolist() == [2 + OTHERS, 0, 1]


def no_others(scale):
    return scale.features[:0], np.zeros(0, dtype=np.int64)


def test_examples_of_other_scans_teach_and_count():
    cloud, semantic = scene()
    prepared, rules = prepare_cloud(cloud), WalkerRules()
    one = labels_of(semantic, 1, prepared)
    other, known = scene(seed=5)
    points = np.flatnonzero(clicks(known, 80) >= 0)
    lent = prepare_cloud(other)
    features = lent.features[lent.scales[0].region[points]]
    many = one._replace(others=features, other_classes=known[points])
    assert teaching_counts(one).tolist() == [1, 1, 1]
    assert teaching_counts(many).tolist() == [61, 61, 61]
    few = one._replace(others=features[:2], other_classes=known[points][:2])
    assert teaching_counts(few).sum() == 5
    assert strength_of(DEFAULT, one, rules) == rules.features_strength  # one a class is not to be trusted
    trust = (61 - 1) / (61 + rules.prior_half - 2)
    wanted = rules.features_strength + trust * (rules.taught_strength - rules.features_strength)
    assert strength_of(DEFAULT, many, rules) == pytest.approx(wanted)
    right = [np.mean(class_shares(prepared, each, 200).argmax(axis=1) == semantic) for each in (one, many)]
    assert right[1] > max(right[0], 0.95)


def test_the_surest_half_of_each_class():
    answer = np.array([[0.9, 0.1], [0.8, 0.2], [0.7, 0.3], [0.6, 0.4], [0.1, 0.9]])
    rows, said = surest_regions(answer)
    assert rows.tolist() == [0, 1, 4]
    assert said.tolist() == [0, 0, 1]


@pytest.mark.parametrize('strength', [0.0, 0.05])
def test_relaxing_comes_to_the_answer_of_a_direct_solve(strength):
    cloud, semantic = scene()
    some = np.random.default_rng(0).permutation(len(cloud))[:600]
    graph = prepare_cloud(cloud.select(np.sort(some))).graphs[0]
    own, generator = semantic[np.sort(some)], np.random.default_rng(1)
    fixed = generator.uniform(size=600) < 0.2
    pull, prior = np.full(600, strength), generator.dirichlet(np.ones(3), 600)
    start = np.where(fixed[:, None], np.eye(3)[own], 1.0 / 3)
    matrix = np.diag(graph.degree + pull) - graph.weights.toarray()
    expected, free = start.copy(), ~fixed
    right = pull[free, None] * prior[free] - matrix[np.ix_(free, fixed)] @ start[fixed]
    expected[free] = np.linalg.solve(matrix[np.ix_(free, free)], right)
    np.testing.assert_allclose(relax(graph, start, prior, pull, fixed, 300), expected, atol=2e-3)
