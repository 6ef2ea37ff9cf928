"""Points of level ground take the class of the nearest revealed one, and kerbs count."""

from dataclasses import replace

import numpy as np
import pytest
from pseudo_labels.patches import make_patches

from rm3d_plugin.engine.replay import decide_again
from rm3d_plugin.pseudo_labels import refresh_points
from rm3d_plugin.pseudo_labels.level import STEP, nearest_level_classes
from rm3d_plugin.regions import MergeLedger, MergeStrategy

STRATEGY = MergeStrategy(gamma=0.6, rounds=4, level_regions=0.9)


def by_hand(xyz, level, truth, reach):
    """Slow twin: every level point looks at every revealed one."""
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
    found = nearest_level_classes(xyz, level, truth, reach)
    assert found.tolist() == by_hand(xyz, level, truth, reach).tolist()
    assert (found >= 0).any() and (nearest_level_classes(xyz, level, np.full(200, -1), reach) == -1).all()


def refresh(patches, strategy, round=0, rows=None, previous=None):
    scene = (patches.cloud, patches.regions, patches.graph, patches.weak)
    return refresh_points(*scene, rows, None, previous, strategy, round, patches.counts, (0,))


@pytest.mark.parametrize('reach', [0.8, None])
def test_floor_and_upright_patches(reach):
    patches = make_patches(1, revealed=0.05)
    patches.graph.normals[::2] = [1.0, 0, 0]  # every second patch stands upright
    level = np.array(patches.regions.labels) % 2 == 1
    strategy = replace(STRATEGY, level_reach=reach)
    first = refresh(patches, strategy)
    near = by_hand(patches.cloud.xyz, level, patches.weak.semantic, reach)
    silent = replace(STRATEGY, level_regions=None)
    plain = refresh(patches, silent).labels.semantic
    expected = np.where(level, near, plain)
    assert first.labels.semantic.tolist() == expected.tolist() and (expected != plain).any()

    rows = np.where(np.eye(3, dtype=bool)[patches.truth], 0.8, 0.1)
    second = refresh(patches, strategy, 1, rows, first.labels)
    assert second.labels.semantic[expected >= 0].tolist() == expected[expected >= 0].tolist()
    assert (second.labels.semantic == patches.truth)[expected < 0].all()  # the network names what is left
    for result, previous in ((first, None), (second, first.labels)):
        ledger = MergeLedger.from_arrays(result.merge.ledger.to_arrays())
        assert decide_again(ledger, result.labels, previous).semantic.tolist() == result.labels.semantic.tolist()


def test_the_choices_are_checked():
    with pytest.raises(ValueError, match=r'MergeStrategy\.level_regions'):
        replace(STRATEGY, level_regions=1.5)
    with pytest.raises(ValueError, match=r'MergeStrategy\.level_reach'):
        replace(STRATEGY, level_reach=0.0)
