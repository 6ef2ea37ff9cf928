import numpy as np
import pytest
from reference.rooms import make_room
from reference.zernike_slow import slow_fourier, slow_silhouette, slow_zernike

from rm3d_plugin.descriptors import VisualSimilarity
from rm3d_plugin.descriptors.visual_similarity import light_fields, patch_centres
from rm3d_plugin.ops.zernike import ORDERS, dodecahedron_views, draw_silhouette, silhouette_features, zernike_basis
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud


def chair(count=1500, seed=0):
    """A seat, a back and one leg: no two views are alike."""
    rng = np.random.default_rng(seed)
    seat = rng.uniform(-1, 1, (count, 3)) * [0.5, 0.4, 0.03]
    back = rng.uniform(-1, 1, (count, 3)) * [0.03, 0.4, 0.3] + [0.5, 0, 0.3]
    leg = rng.uniform(-1, 1, (count // 3, 3)) * [0.04, 0.04, 0.3] + [-0.4, 0.3, -0.3]
    return np.concatenate([seat, back, leg])


def describe(points, **options):
    return light_fields(points, np.zeros((1, 3)), 1.2, **options).values.reshape(1, -1)


def features_of(image):
    out = np.empty(45)
    silhouette_features(image, zernike_basis(len(image)), out)
    return out


def test_silhouettes_and_features_equal_their_slow_twins():
    views = dodecahedron_views()
    points = chair(60)
    found = light_fields(points, np.zeros((1, 3)), 1.2, resolution=24, splat=0.08)
    for view in range(10):
        frame = views.rights[view], views.ups[view]
        want = slow_silhouette(points, *frame, 1.2, 0.08, 24)
        image = np.ones((24, 24), dtype=bool)
        draw_silhouette(points, np.arange(len(points)), np.zeros(3), *frame, 1.2, 0.08, image)
        np.testing.assert_array_equal(image, want)
        row = found.values[0, view]
        np.testing.assert_allclose(row[:35:5], [slow_zernike(want, n, m) for n, m in ORDERS[::5]], atol=1e-6)
        np.testing.assert_allclose(row[35:], slow_fourier(want), atol=1e-6)


def test_thirty_five_orders_and_a_full_disc():
    assert len(ORDERS) == len(set(ORDERS)) == 35 and max(ORDERS) == (10, 10)
    middle = (np.arange(200) + 0.5) / 100 - 1
    disc = np.hypot(*np.meshgrid(middle, middle)) <= 1
    row = features_of(disc)
    assert row[:35].max() < 5e-3 and row[35:].max() < 0.01  # orthogonal to (0, 0); a constant outline
    half = disc & (middle[:, None] > 0)
    # By hand: the mean of y over a half disc is 4 / (3 pi); of 2 rho^2 - 1 it is 0.
    assert features_of(half)[ORDERS.index((1, 1))] == pytest.approx(4 / (3 * np.pi), abs=2e-3)
    assert features_of(half)[ORDERS.index((2, 0))] == pytest.approx(0, abs=2e-3)


def test_turned_and_mirrored_images_have_equal_features():
    image = np.zeros((32, 32), dtype=bool)
    image[8:20, 6:25], image[14:27, 10:14] = True, True
    row = features_of(image)
    np.testing.assert_allclose(features_of(image[::-1, ::-1].copy()), row, atol=1e-12)
    for other in (image[::-1].copy(), image.T.copy(), np.rot90(image).copy()):
        np.testing.assert_allclose(features_of(other)[:35], row[:35], atol=1e-12)
        np.testing.assert_allclose(features_of(other)[35:], row[35:], atol=0.08)  # pixels may change sector
    assert not features_of(np.zeros((32, 32), dtype=bool)).any()


def test_views_are_ten_axes():
    views = dodecahedron_views()
    between = np.abs(views.axes @ views.axes.T)[~np.eye(10, dtype=bool)]
    assert set(between.round(6)) == {round(5**0.5 / 3, 6), round(1 / 3, 6)}
    np.testing.assert_allclose(np.linalg.norm(views.axes, axis=1), 1)
    np.testing.assert_allclose(np.cross(views.axes, views.rights), views.ups)


def test_size_and_place_do_not_matter():
    points = chair()
    first = describe(points)
    moved = light_fields(points * 4 + [8, -16, 32], np.array([[8.0, -16, 32]]), 4.8).values
    np.testing.assert_allclose(moved.reshape(1, -1), first, atol=0.02)


def test_points_take_the_patch_of_the_nearest_centre():
    xyz = make_room(density=60)[0]
    rows = patch_centres(xyz, 0.5)
    cells = np.floor(xyz[rows].astype(np.float64) / 0.5)
    assert len(np.unique(cells, axis=0)) == len(rows)
    assert len(rows) == len(np.unique(np.floor(xyz.astype(np.float64) / 0.5), axis=0))
    described = VisualSimilarity(radius=0.6, spacing=0.5).compute(PointCloud(xyz))
    assert described.values.shape == (len(xyz), 450)
    assert described.values.min() >= 0 and described.values.max() <= 1
    nearest = ((xyz[::40, None] - xyz[rows][None]) ** 2).sum(axis=2).argmin(axis=1)
    want = light_fields(xyz, xyz[rows], 0.6)
    np.testing.assert_array_equal(described.values[::40], want.values[nearest].reshape(-1, 450))
    np.testing.assert_array_equal(described.valid[::40], want.valid[nearest])
    assert described.valid.mean() > 0.99


def test_empty_few_and_duplicate_points():
    for xyz, valid in (
        (np.zeros((0, 3)), False),
        (np.zeros((1, 3)), False),
        (np.ones((5, 3)), False),
        (np.eye(3) / 9, True),
    ):
        described = VisualSimilarity().compute(PointCloud(xyz))
        assert described.values.shape == (len(xyz), 450)
        assert (described.valid == valid).all() and np.isfinite(described.values).all()
        assert valid or not described.values.any()


def test_presets_and_wrong_input():
    assert VisualSimilarity.preset('lidar').radius == 1.0
    with pytest.raises(ValueError, match="got 'sea'"):
        VisualSimilarity.preset('sea')
    with pytest.raises(ValueError, match='resolution >= 8'):
        DESCRIPTORS.build(dict(type='VisualSimilarity', resolution=4))
    with pytest.raises(ValueError, match='NaN'):
        light_fields(np.full((3, 3), np.nan), np.zeros((1, 3)), 1.0)
