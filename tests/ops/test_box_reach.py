"""How far up what boxes hold reaches, against a loop."""

import numpy as np
import pytest

from rm3d_plugin.ops.box_reach import box_reach


def slow_reach(height, owner, count):
    tops, gaps = [], []
    for box in range(count):
        own = sorted(h for h, o in zip(height, owner, strict=True) if o == box)
        tops.append(own[-1] if own else -np.inf)
        gaps.append(max((b - a for a, b in zip(own[:-1], own[1:], strict=True)), default=0.0))
    return tops, gaps


@pytest.mark.parametrize('seed', range(4))
def test_how_far_up_points_reach(seed):
    rng = np.random.default_rng(seed)
    owner, height = rng.integers(-1, 5, 30), rng.uniform(-0.2, 2.0, 30).astype(np.float32)
    tops, gaps = slow_reach(height, owner, 6)
    got = box_reach(height, owner, 6)
    assert got.top.tolist() == pytest.approx(tops) and got.gap.tolist() == pytest.approx(gaps)
