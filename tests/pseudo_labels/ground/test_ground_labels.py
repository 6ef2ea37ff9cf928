"""Points of level ground take the class of the nearest annotated one and of the network, and kerbs count."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels import refreshing
from pseudo_labels.patches import make_patches

from rm3d_plugin.pseudo_labels import GroundRules, SegmentationRules
from rm3d_plugin.pseudo_labels.common.distance_prior import DECAY
from rm3d_plugin.pseudo_labels.ground.labels import FAR, STEP, nearest_ground_labels
from rm3d_plugin.regions import MergeLedger, MergeRules
from rm3d_plugin.reporting.replay import decide_again

RULES = SegmentationRules(MergeRules(gamma=0.6, rounds=4), ground=GroundRules(min_upright=0.9))


def by_hand(xyz, level, truth, reach):
    """Slow twin: every level point looks at every annotated one."""
    out = np.full(len(xyz), -1)
    for i in np.flatnonzero(level):
        near = [(np.linalg.norm((xyz[i] - xyz[j]) / [1, 1, STEP]), j) for j in np.flatnonzero(level & (truth >= 0))]
        if near and (reach is None or min(near)[0] < reach):
            out[i] = truth[min(near)[1]]
    return out


@pytest.mark.parametrize('reach', [0.3, 2.0, None])
def test_as_by_hand(reach):
    rng = np.random.default_rng(0)
    xyz = rng.random((200, 3)) * [4, 4, 0.2]
    level, truth = rng.random(200) < 0.7, np.where(rng.random(200) < 0.1, rng.integers(0, 3, 200), -1)
    found, sure = nearest_ground_labels(xyz, level, truth, None, reach)
    assert found.tolist() == by_hand(xyz, level, truth, reach).tolist()
    assert (found >= 0).any() and sure.tolist() == (found >= 0).tolist()
    assert (nearest_ground_labels(xyz, level, np.full(200, -1), None, reach).classes == -1).all()


def test_with_a_network_as_by_hand():
    rng = np.random.default_rng(1)
    xyz = rng.random((150, 3)) * [40, 4, 0.2]
    level, truth = rng.random(150) < 0.7, np.where(rng.random(150) < 0.1, rng.integers(0, 3, 150), -1)
    rows = rng.dirichlet(np.full(4, 0.3), 150)  # nobody annotated a point of class 3
    rows[::7] = np.nan
    found, sure = nearest_ground_labels(xyz, level, truth, rows, 0.1)  # the network knows what lies out of reach
    for i, row in enumerate(rows):
        if not level[i] or np.isnan(row).any():
            assert (found[i], sure[i]) == (-1, 0.0)
            continue
        said = np.zeros(4)
        for c in range(3):
            distance = min(
                np.linalg.norm((xyz[i] - xyz[j]) / [1, 1, STEP]) for j in np.flatnonzero(level & (truth == c))
            )
            said[c] = row[c] * (1 + min(distance, FAR)) ** -DECAY
        assert found[i] == said.argmax() and sure[i] == pytest.approx(said.max() / said.sum())
    assert (found[level & (rows[:, :3].argmax(axis=1) != found)] >= 0).any()  # places had a say
    blind = nearest_ground_labels(xyz, level, truth, np.full((150, 4), np.nan), None)
    assert (blind.classes == -1).all()
    nobody = nearest_ground_labels(xyz, level, np.full(150, -1), rows, None)
    assert (nobody.classes == -1).all() and (nobody.confidence == 0).all()


def refresh(patches, rules, round=0, rows=None, previous=None):
    scene = refreshing.inputs(patches, rows=rows, previous=previous)
    return refreshing.points(scene, rules, round, patches.counts, (0,))


@pytest.mark.parametrize('reach', [0.8, None])
def test_floor_and_upright_patches(reach):
    patches = make_patches(1, share=0.05)
    patches.graph.normals[::2] = [1.0, 0, 0]  # every second patch stands upright
    level = np.array(patches.regions.labels) % 2 == 1
    rules = replace(RULES, ground=GroundRules(min_upright=0.9, max_distance=reach))
    first = refresh(patches, rules)
    near = by_hand(patches.cloud.xyz, level, patches.annotated.semantic, reach)
    plain = refresh(patches, replace(RULES, ground=None)).labels.semantic
    expected = np.where(level, near, plain)
    assert first.labels.semantic.tolist() == expected.tolist() and (expected != plain).any()

    rows = np.where(np.eye(3, dtype=bool)[patches.truth], 0.8, 0.1)
    second = refresh(patches, rules, 1, rows, first.labels)
    together = nearest_ground_labels(patches.cloud.xyz, level, patches.annotated.semantic, rows, reach).classes
    known = patches.annotated.semantic >= 0
    wanted = np.where(known, patches.annotated.semantic, np.where(level, together, expected))
    assert second.labels.semantic[wanted >= 0].tolist() == wanted[wanted >= 0].tolist()
    assert (second.labels.semantic == patches.truth)[wanted < 0].all()  # the network names what is left
    assert (second.labels.semantic == patches.truth)[level].mean() > (first.labels.semantic == patches.truth)[
        level
    ].mean()
    for result, previous in ((first, None), (second, first.labels)):
        ledger = MergeLedger.from_arrays(result.merge.ledger.to_arrays())
        assert decide_again(ledger, result.labels, previous).semantic.tolist() == result.labels.semantic.tolist()


def test_the_choices_are_checked():
    with pytest.raises(ValueError, match=r'GroundRules\.min_upright: expected in \[0, 1\], got 1.5'):
        GroundRules(min_upright=1.5)
    with pytest.raises(ValueError, match=r'GroundRules\.max_distance: expected a number > 0, or None, got 0.0'):
        GroundRules(max_distance=0.0)
    with pytest.raises(ValueError, match=r"GroundRules\.classifier: expected one of \('nearest', 'kernel'\)"):
        GroundRules(classifier='shape')
