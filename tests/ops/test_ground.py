import numpy as np
import pytest
from reference.kitti_frames import frames, read_frame

from rm3d_plugin.ops import ground
from rm3d_plugin.ops.ground import segment_ground
from rm3d_plugin.structures import SceneError


def street(slope=0.0, cross=0.0, extra=(), seed=0, noise=0.02, size=40.0):
    """A plane of that slope with 4 points a square metre, and what stands on it (heights over the plane)."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-size, size, (int(4 * 4 * size * size), 2))
    xyz = np.c_[xy, rng.normal(0, noise, len(xy))]
    xyz = np.concatenate([xyz, *extra])
    xyz[:, 2] += slope * xyz[:, 0] + cross * xyz[:, 1]
    return xyz, np.arange(len(xyz)) < len(xy)


def car(x, y, seed=1):
    """Points on the roof and the sides of a box of 4.2 x 1.8 x 1.5 m, from 0.3 m above the ground."""
    rng = np.random.default_rng(seed)
    unit = rng.uniform(-0.5, 0.5, (900, 3))
    unit[:300, 2] = 0.5
    unit[300:600, 1] = -0.5
    unit[600:, 0] = -0.5
    return unit * [4.2, 1.8, 1.2] + [x, y, 0.9]


@pytest.mark.parametrize(('slope', 'cross'), [(0.0, 0.0), (0.1, 0.05), (0.2, 0.0), (-0.15, 0.1)])
def test_plane_with_cars_is_split_at_any_slope_below_the_limit(slope, cross):
    xyz, is_plane = street(slope, cross, [car(5, 3), car(-12, 8), car(0, -20)])
    inside = np.zeros(len(xyz), dtype=bool)  # a car hides the ground under it
    for x, y in ((5, 3), (-12, 8), (0, -20)):
        inside |= is_plane & (np.abs(xyz[:, 0] - x) < 2.1) & (np.abs(xyz[:, 1] - y) < 0.9)
    xyz, is_plane = xyz[~inside], is_plane[~inside]
    result = segment_ground(xyz)
    assert result.is_ground[is_plane].mean() > 0.999
    assert result.is_ground[~is_plane].sum() == 0
    truth = xyz[:, 2] - slope * xyz[:, 0] - cross * xyz[:, 1]
    assert np.abs(result.height - truth).max() < 0.15


def test_heights_are_relative_to_a_rolling_surface():
    xyz, is_plane = street()
    hill = 1.5 * np.sin(xyz[:, 0] / 12.0)
    xyz[:, 2] += hill
    result = segment_ground(xyz)
    assert result.is_ground[is_plane].mean() > 0.99
    assert np.median(np.abs(result.height - (xyz[:, 2] - hill))) < 0.06


def test_hill_side_beyond_the_limit_stays():
    rng = np.random.default_rng(2)
    bank = np.c_[rng.uniform(20, 30, 4000), rng.uniform(-40, 40, 4000), np.zeros(4000)]
    bank[:, 2] = (bank[:, 0] - 20.0) * 0.7
    xyz, is_plane = street(extra=[bank])
    keep = ~(is_plane & (xyz[:, 0] > 20))
    result = segment_ground(xyz[keep])
    assert result.is_ground[is_plane[keep]].mean() > 0.98
    assert result.is_ground[~is_plane[keep] & (xyz[keep][:, 2] > 1.0)].mean() < 0.02


def test_low_bush_stands_out():
    rng = np.random.default_rng(3)
    bush = np.c_[rng.uniform(5, 7, 500), rng.uniform(-1, 1, 500), rng.uniform(0.3, 0.7, 500)]
    result = segment_ground(street(extra=[bush])[0])
    assert not result.is_ground[-500:].any()


def test_cells_without_ground_borrow_from_around():
    """A roof of 6 x 6 m with no ground under it: heights there come from the ground around."""
    rng = np.random.default_rng(4)
    roof = np.c_[rng.uniform(-3, 3, (800, 2)), np.full(800, 2.5)]
    xyz, is_plane = street(slope=0.1, extra=[roof])
    keep = ~(is_plane & (np.abs(xyz[:, :2]) < 3).all(axis=1))
    result = segment_ground(xyz[keep])
    assert not result.is_ground[-800:].any()
    np.testing.assert_allclose(result.height[-800:], 2.5, atol=0.1)


def test_ghost_returns_under_the_ground_do_not_pull_it_down():
    xyz, is_plane = street(extra=[np.array([[3.0, 3.0, -4.0], [3.1, 3.0, -3.0], [200.0, 0.0, -30.0]])])
    result = segment_ground(xyz)
    assert result.is_ground[is_plane].mean() > 0.999
    assert abs(np.median(result.height[is_plane])) < 0.06


def test_order_and_place_do_not_matter():
    xyz, _ = street(0.05, 0.02, [car(5, 3)])
    whole = segment_ground(xyz)
    order = np.random.default_rng(5).permutation(len(xyz))
    np.testing.assert_array_equal(segment_ground(xyz[order]).height, whole.height[order])
    moved = segment_ground(xyz + [1024.0, -512.0, 64.0])
    np.testing.assert_allclose(moved.height, whole.height, atol=1e-3)


def test_lower_envelope_equals_all_pairs():
    lowest = np.random.default_rng(6).uniform(0, 3, (9, 7))
    rows, columns = np.indices(lowest.shape).reshape(2, -1)
    dx, dy = np.abs(rows[:, None] - rows), np.abs(columns[:, None] - columns)
    octile = np.maximum(dx, dy) + (np.sqrt(2) - 1) * np.minimum(dx, dy)
    expected = (lowest.reshape(1, -1) + 0.3 * octile).min(axis=1)
    np.testing.assert_allclose(ground._lower_envelope(lowest, 0.3, 0.1).ravel(), expected, atol=1e-12)


def test_empty_single_and_duplicate_points():
    assert len(segment_ground(np.zeros((0, 3))).is_ground) == 0
    for xyz in (np.array([[4.0, 5.0, 6.0]]), np.tile([[4.0, 5.0, 6.0]], (10, 1))):
        result = segment_ground(xyz)
        assert result.is_ground.all()
        np.testing.assert_allclose(result.height, 0.0, atol=1e-6)


def test_bad_input_is_named():
    with pytest.raises(SceneError, match='NaN'):
        segment_ground(np.array([[0.0, np.nan, 0.0]]))
    with pytest.raises(ValueError, match='max_slope > 0'):
        segment_ground(np.zeros((1, 3)), max_slope=0.0)


def test_stray_points_far_off_are_no_ground_and_change_nothing_else():
    xyz = street()[0]
    strays = np.array([[1e6, 1e6, 0.0], [-1e6, 0.0, -50.0]])
    result = segment_ground(np.concatenate([strays[:1], xyz, strays[1:]]))
    want = segment_ground(xyz)
    assert not result.is_ground[[0, -1]].any() and np.isfinite(result.height).all()
    np.testing.assert_array_equal(result.is_ground[1:-1], want.is_ground)
    np.testing.assert_array_equal(result.height[1:-1], want.height)


def test_real_street_scans(real_data):
    wrong = objects = found = road = 0
    for frame in frames(real_data):
        scan = read_frame(real_data, frame)
        is_ground = segment_ground(scan.xyz).is_ground
        on_object = (scan.instance >= 0) & (scan.over_bottom > 0.25)
        on_road = (scan.xyz[:, 2] < -1.5) & (np.hypot(*scan.xyz[:, :2].T) < 20) & (scan.instance < 0)
        wrong, objects = wrong + (is_ground & on_object).sum(), objects + on_object.sum()
        found, road = found + is_ground[on_road].sum(), road + on_road.sum()
    assert wrong / objects < 0.01
    assert found / road > 0.97
