"""Morton codes against codes put together bit by bit."""

import numpy as np

from rm3d_plugin.ops.morton import BITS, Grid, enclosing_cube, gather_bits, morton_codes, morton_order, sort_codes


def slow_code(cell):
    return sum(((int(cell[axis]) >> bit) & 1) << (3 * bit + axis) for bit in range(BITS) for axis in range(3))


def test_codes_bit_by_bit():
    cells = np.random.default_rng(0).integers(0, 2**BITS, (200, 3))
    codes = morton_codes(cells + 0.5, Grid(np.zeros(3), 2.0**BITS))
    assert codes.dtype == np.uint64
    assert codes.tolist() == [slow_code(cell) for cell in cells]


def test_octants_in_order():
    corners = np.array([[x, y, z] for z in (0.1, 0.9) for y in (0.1, 0.9) for x in (0.1, 0.9)])
    assert morton_order(corners[::-1], Grid(np.zeros(3), 1.0)).tolist() == list(range(8))[::-1]


def test_outside_counts_as_border():
    codes = morton_codes(np.array([[-5.0, -5, -5], [0, 0, 0], [9, 9, 9], [1, 1, 1]]), Grid(np.zeros(3), 1.0))
    assert codes[0] == codes[1] == 0
    assert codes[2] == codes[3] == 2**63 - 1


def test_cube_of_nothing_and_of_one_place():
    assert enclosing_cube(np.zeros((0, 3))).edge == 1.0
    cube = enclosing_cube(np.full((3, 3), 7.0))
    assert cube.edge == 1.0 and cube.low.tolist() == [7.0] * 3
    assert morton_codes(np.zeros((0, 3))).shape == (0,)
    assert morton_order(np.full((4, 3), 7.0)).tolist() == [0, 1, 2, 3]


def test_large_arrays_sort_as_numpy_does():
    from rm3d_plugin.ops.morton import RADIX_FROM

    rng = np.random.default_rng(0)
    for top in (3, 2**40, 2**63 - 1):  # many equal codes, empty high digits, all digits
        codes = rng.integers(0, top, 3 * RADIX_FROM + 7, dtype=np.uint64)
        found = sort_codes(codes)
        np.testing.assert_array_equal(found.order, np.argsort(codes, kind='stable'))
        np.testing.assert_array_equal(found.codes, np.sort(codes))
    ascending = np.sort(rng.integers(0, 9, 50, dtype=np.uint64))
    np.testing.assert_array_equal(sort_codes(ascending).order, np.arange(50))


def test_bits_come_back():
    cells = np.random.default_rng(1).integers(0, 2**BITS, (100, 3))
    codes = morton_codes(cells + 0.5, Grid(np.zeros(3), 2.0**BITS))
    assert [[int(gather_bits(code >> np.uint64(axis))) for axis in range(3)] for code in codes] == cells.tolist()


def test_sorting_shares_its_blocks(monkeypatch):
    monkeypatch.setattr('rm3d_plugin.ops.morton.TOGETHER', 1000)
    rng = np.random.default_rng(2)
    codes = rng.integers(0, 2**63 - 1, 7777, dtype=np.uint64)
    codes[3000:5000] = codes[0]
    for threads in (1, 3):
        monkeypatch.setattr('numba.config.NUMBA_NUM_THREADS', threads)
        for given in (codes, np.sort(codes), np.r_[np.sort(codes), codes[:1]]):
            found = sort_codes(given)
            np.testing.assert_array_equal(found.order, np.argsort(given, kind='stable'))
            np.testing.assert_array_equal(found.codes, np.sort(given))
        points = rng.normal(size=(5432, 3))
        cube = enclosing_cube(points)
        np.testing.assert_array_equal(cube.low, points.min(axis=0))
        assert cube.edge == np.ptp(points, axis=0).max()
