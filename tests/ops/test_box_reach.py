"""How far up what boxes hold reaches, against a loop."""

import numpy as np
import pytest

from rm3d_plugin.ops.box_reach import box_reach


def slow_reach(height, owner, count, ground):
    tops, gaps = [], []
    for box in range(count):
        own = sorted(h for h, o in zip(height, owner, strict=True) if o == box)
        tops.append(own[-1] if own else -np.inf)
        gaps.append(max([0.0, *(b - a for a, b in zip([ground, *own][: len(own)], own, strict=True))]))
    return tops, gaps


@pytest.mark.parametrize('seed', range(4))
def test_how_far_up_points_reach(seed):
    rng = np.random.default_rng(seed)
    owner, height = rng.integers(-1, 5, 30), rng.uniform(-0.2, 2.0, 30).astype(np.float32)
    ground = 0.2 * (seed % 2)
    tops, gaps = slow_reach(height, owner, 6, ground)
    got = box_reach(height, owner, 6, ground)
    assert got.top.tolist() == pytest.approx(tops) and got.gap.tolist() == pytest.approx(gaps)


def test_a_single_beam_may_have_missed_what_is_below_and_above():
    got = box_reach(np.array([0.7]), np.array([0]), 2)
    assert got.top.tolist() == [0.7, -np.inf] and got.gap.tolist() == [0.7, 0.0]
    assert box_reach(np.array([0.7]), np.array([0]), 1, ground=0.2).gap.tolist() == pytest.approx([0.5])
    assert box_reach(np.zeros(0), np.zeros(0, dtype=int), 1).top.tolist() == [-np.inf]
