import numpy as np
import pytest
from reference.clearance_slow import slow_clearance

from rm3d_plugin.ops.clearance import clearance


@pytest.mark.parametrize(('cell', 'reach'), [(0.5, 0), (0.5, 1), (1.3, 2)])
def test_equals_the_slow_twin(cell, reach):
    rng = np.random.default_rng(0)
    xyz = (rng.normal(size=(300, 3)) * [2, 2, 6]).astype(np.float32)
    xyz[:40] = xyz[40:80]  # twice the same place
    np.testing.assert_allclose(clearance(xyz, cell, reach), slow_clearance(xyz, cell, reach), atol=1e-6)


def test_a_wire_over_a_street_by_hand():
    """Ground in the lowest cell, a wire 8 m above it: 15 free cells of half a metre between them, nothing above."""
    got = clearance(np.array([[0.2, 0.2, 0.1], [0.2, 0.2, 8.1], [0.7, 0.2, 3.0]]))
    np.testing.assert_allclose(got[0], [8 / 15, 0, 8 / 15, 1, 0.75, 2 / 17], atol=1e-6)
    np.testing.assert_allclose(got[1], [8 / 15, 8 / 15, 0, 0.75, 1, 2 / 17], atol=1e-6)
    np.testing.assert_allclose(got[2], [0, 0, 0, 1, 1, 1])  # alone in its column
    wide = clearance(np.array([[0.2, 0.2, 0.1], [0.2, 0.2, 8.1], [0.7, 0.2, 3.0]]), reach=1)
    np.testing.assert_allclose(wide[1, 3], 0.45, atol=1e-6)  # 9 free cells down to the neighbour


def test_density_and_order_do_not_matter():
    rng = np.random.default_rng(1)
    xyz = rng.uniform(0, 6, (500, 3))
    order = rng.permutation(500)
    assert np.array_equal(clearance(xyz[order], reach=1), clearance(xyz, reach=1)[order])
    assert np.array_equal(clearance(np.repeat(xyz, 3, axis=0)), np.repeat(clearance(xyz), 3, axis=0))
    far = clearance(xyz + [0, 0, 1e6])  # heights count from the column's own lowest cell
    assert np.isfinite(far).all() and far.min() >= 0 and far.max() <= 1


def test_few_points():
    assert clearance(np.zeros((0, 3))).shape == (0, 6)
    assert clearance(np.zeros((1, 3))).tolist() == [[0, 0, 0, 1, 1, 1]]
