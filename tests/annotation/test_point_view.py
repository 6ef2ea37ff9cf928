import numpy as np
import pytest

from rm3d_plugin.annotation.point_view import (
    Camera,
    clearest_way,
    colors_by,
    point_hit,
    points_in_lasso,
    points_in_rectangle,
)
from rm3d_plugin.inference.label_scan import LabelledScan
from rm3d_plugin.structures import PointCloud

EYE = (0.0, 0.0, 10.0)
DOWN = np.diag([1.0, -1.0, -1.0])  # columns: right, down and forward of an eye that looks down
GRID = np.stack(np.meshgrid(np.arange(-2, 2.1, 0.1), np.arange(-2, 2.1, 0.1), indexing='ij'), axis=-1).reshape(-1, 2)
FLOOR = np.concatenate([GRID, np.zeros((len(GRID), 1))], axis=1).astype(np.float32)
ROOF = FLOOR + np.array([0.0, 0.0, 3.0], np.float32)


@pytest.mark.parametrize('row', [0, 17, 840, 1680])
def test_a_ray_meets_the_point_it_is_aimed_at(row):
    direction = FLOOR[row] - np.array(EYE)
    assert point_hit(FLOOR, EYE, tuple(direction), 0.05) == row
    assert point_hit(FLOOR, EYE, tuple(-direction), 0.05) is None  # it lies behind
    over = np.concatenate([FLOOR, ROOF])
    first = point_hit(over, EYE, tuple(direction), 0.1)
    above = ROOF[first - len(FLOOR)] if first >= len(FLOOR) else None
    if abs(direction[:2]).max() < 1.3:  # the roof is in the way there
        assert above is not None
        np.testing.assert_allclose(above[:2], direction[:2] * 0.7, atol=0.08)


def test_a_ray_beside_all_points_meets_none():
    assert point_hit(FLOOR, EYE, (1.0, 0.0, -1.0), 0.05) is None


def test_a_rectangle_holds_what_the_picture_shows_in_it():
    camera = Camera(np.array(EYE), DOWN, 2 * np.arctan(0.2), 1.0)  # the picture is 4 m wide at the floor
    found = points_in_rectangle(FLOOR, camera, (0.5, 0.25), (0.75, 0.5))
    inside = (FLOOR[:, 0] >= -1e-6) & (FLOOR[:, 0] <= 1 + 1e-6) & (FLOOR[:, 1] >= -1e-6) & (FLOOR[:, 1] <= 1 + 1e-6)
    assert set(found) <= set(np.flatnonzero(inside)) and len(found) >= 0.8 * inside.sum()  # edges by rounding
    assert not len(points_in_rectangle(FLOOR, camera, (1.5, 1.5), (1.6, 1.6)))


def test_a_rectangle_leaves_out_what_is_hidden():
    dense = np.random.default_rng(0).uniform(-2, 2, (60_000, 2))
    roof = np.concatenate([dense, np.full((len(dense), 1), 3.0)], axis=1)
    camera = Camera(np.array(EYE), DOWN, 2 * np.arctan(0.2), 1.0)
    found = points_in_rectangle(np.concatenate([FLOOR, roof]), camera, (0.4, 0.4), (0.6, 0.6))
    assert (found >= len(FLOOR)).mean() > 0.998 and len(found) > 100


def test_colours_tell_what_they_are_asked_for():
    cloud = PointCloud(
        np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2.0]]), colors=np.array([[1, 0, 0], [0, 1, 0], [0, 0, 0.5]])
    )
    region, clicks = np.array([0, 0, 1]), np.array([1, 0])
    labels = LabelledScan.spread(np.array([1, 0, -1]), np.array([1.0, 0.5, 0.0], np.float32), region, clicks)
    palette = ['#102030', '#ff0080']
    assert colors_by('colour', cloud, labels, palette).tolist() == [[255, 0, 0], [0, 255, 0], [0, 0, 128]]
    assert colors_by('class', cloud, labels, palette).tolist() == [
        [255, 0, 128],
        [16, 32, 48],
        [88, 88, 88],
    ]  # dark ones darker
    regions = colors_by('region', cloud, labels, palette)
    assert (regions[0] == regions[1]).all() and (regions[0] != regions[2]).any()
    low, high = colors_by('confidence', cloud, labels, palette)[[2, 0]].astype(int).sum(axis=1)
    assert low < high
    np.testing.assert_array_equal(
        colors_by('intensity', cloud, labels, palette), colors_by('height', cloud, labels, palette)
    )  # it has none


def test_what_other_labels_contradict_is_red_and_what_nobody_asked_is_grey():
    cloud = PointCloud(np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2.0]]), colors=np.ones((3, 3)))
    nobody = np.zeros(3, dtype=np.int64)
    labels = LabelledScan.spread(nobody, np.array([0.0, 1.0, np.nan]), nobody, np.array([2]))
    (red, *_), (*_, blue), grey = colors_by('check', cloud, labels, ['#102030']).astype(int)
    assert red > 80 and blue > 70 and len(set(grey.tolist())) == 1


def test_a_place_under_a_roof_is_looked_at_from_the_side():
    place, up = np.zeros(3), np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(clearest_way(FLOOR, place, up, 1.5), up)
    low_roof = FLOOR[(np.abs(FLOOR[:, :2]) < 1.1).all(axis=1)] + np.array([0.0, 0.0, 0.9], np.float32)
    way = clearest_way(np.concatenate([FLOOR, low_roof]), place, up, 1.5)
    assert np.linalg.norm(way) == pytest.approx(1) and way[2] == pytest.approx(np.sin(np.deg2rad(20)))


def test_a_place_that_a_single_point_hides_is_looked_at_from_beside_it():
    place, before = np.zeros(3), np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    hides, in_the_ball = 0.15 * before[None], 0.03 * before[None]
    np.testing.assert_allclose(clearest_way(in_the_ball, place, before, 1.0), before)
    assert clearest_way(hides, place, before, 1.0) @ before < 0.999


def test_a_place_under_a_lid_is_looked_at_from_below():
    turns = np.deg2rad(np.arange(0.0, 360.0, 3.0))
    lid = [np.array([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)]) for turn in turns
           for up in np.deg2rad(np.arange(0.0, 91.0, 3.0))]  # fmt: skip
    way = clearest_way(0.4 * np.array(lid), np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0)
    assert way[2] == pytest.approx(-np.sin(np.deg2rad(50)))  # past the rim of the lid


def test_a_lasso_holds_what_a_polygon_of_the_picture_shows():
    camera = Camera(np.array(EYE), DOWN, 2 * np.arctan(0.2), 1.0)  # the picture is 4 m wide at the floor
    triangle = np.array([(0.5, 0.25), (0.75, 0.5), (0.5, 0.5)])  # corners (0, 1), (1, 0) and (0, 0) on the floor
    found = points_in_lasso(
        np.concatenate([FLOOR, FLOOR + [0, 0, 50.0]]), camera, triangle
    )  # others are behind the eye
    x, y = FLOOR[:, 0], FLOOR[:, 1]
    strictly = (x > 1e-3) & (y > 1e-3) & (x + y < 1 - 1e-3)
    edge = (x > -1e-3) & (y > -1e-3) & (x + y < 1 + 1e-3)
    assert set(np.flatnonzero(strictly)) <= set(found) <= set(np.flatnonzero(edge))
