import io

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from rm3d_plugin.structures import Boxes3D
from rm3d_plugin.visualization.bev import (
    BevPanel,
    BoxLayer,
    class_point_colors,
    draw_bev,
    footprints,
    headings,
    scene_panels,
    span_of,
)
from rm3d_plugin.visualization.palette import SERIES, by_height, class_color, region_colors

BOXES = Boxes3D(np.array([[10.0, 2, 0, 4, 2, 1.5, np.pi / 2]]), np.array([0]))
XYZ = np.random.default_rng(0).uniform(0, 20, (500, 3))


def test_outlines_close_and_lie_where_the_box_does():
    line = footprints(BOXES)[0]
    np.testing.assert_array_equal(line[0], line[-1])
    # Turned by 90 degrees, the length lies along y.
    np.testing.assert_allclose([line.min(axis=0), line.max(axis=0)], [[9, 0], [11, 4]], atol=1e-12)
    np.testing.assert_allclose(headings(BOXES)[0], [[10, 2], [10, 4]], atol=1e-12)


def test_class_colors_grey_out_what_has_no_class():
    colors = class_point_colors(np.array([0, 1, -1, 2]), num_classes=2)
    np.testing.assert_allclose(colors[0], [int(SERIES[0][i : i + 2], 16) / 255 for i in (1, 3, 5)])
    np.testing.assert_array_equal(colors[2], colors[3])
    assert not np.allclose(colors[1], colors[0])


def test_region_colors_depend_on_the_number_alone():
    a = region_colors(np.array([3, -1, 7, 3]))
    assert ((a >= 0) & (a <= 1)).all()
    np.testing.assert_array_equal(a[0], a[3])
    np.testing.assert_array_equal(a[1], [0.8] * 3)
    np.testing.assert_array_equal(region_colors(np.array([7]))[0], a[2])
    assert len(np.unique(region_colors(np.arange(50)).round(6), axis=0)) == 50


def test_the_span_holds_every_box():
    far = Boxes3D(np.array([[100.0, 0, 0, 4, 2, 1.5, 0]]), np.array([0]))
    span = span_of([BevPanel('p', XYZ, layers=[BoxLayer('b', far, 'red')])], margin=1)
    assert span[2] == pytest.approx(103)
    assert span_of([BevPanel('p', np.zeros((0, 3)))]) == (-1, -1, 1, 1)


def test_picture_is_a_png_and_repeats():
    panels = scene_panels(
        XYZ,
        ('Car',),
        np.arange(500) // 50,
        np.zeros(500, dtype=int),
        truth=BOXES,
        pseudo=BOXES,
        predicted=Boxes3D.empty(),
    )
    assert [p.title for p in panels] == ['10 regions', 'Pseudo labels', 'Predictions']
    assert [layer.name for layer in panels[2].layers] == ['truth', 'predicted, with score']
    assert all(panel.legend_beside for panel in panels[1:])
    png = draw_bev(panels, dpi=40)
    image = imread(io.BytesIO(png))
    assert image.shape[1] == pytest.approx(3 * 4.2 * 40, abs=2)
    assert png == draw_bev(panels, dpi=40)


def test_empty_and_single_point_scenes_are_drawn():
    for xyz in (np.zeros((0, 3)), np.ones((1, 3))):
        assert draw_bev(scene_panels(xyz, ('Car',)), dpi=30).startswith(b'\x89PNG')
    with pytest.raises(ValueError, match='no panel'):
        draw_bev([])


def test_boxes_have_the_colour_of_their_class_and_their_score():
    tensor = np.array([[0.0, 0, 0, 4, 2, 1.5, 0], [8.0, 0, 0, 4, 2, 1.5, 1]])
    boxes = Boxes3D(tensor, np.array([0, 1]), np.array([0.9, 0.4]))
    with_scores, without = (
        draw_bev([BevPanel('p', XYZ, layers=[BoxLayer('b', boxes, None, scores=scores)])], dpi=80)
        for scores in (True, False)
    )
    assert with_scores != without
    image = (imread(io.BytesIO(without))[..., :3] * 255).round().astype(int)
    for number in (0, 1):
        near = np.abs(image - np.round(np.array(to_rgb(class_color(number))) * 255)).max(axis=2) < 12
        assert near.sum() > 20


def test_heights_go_from_dark_to_light():
    colors = by_height(np.stack([np.zeros(100), np.zeros(100), np.linspace(0, 5, 100)], axis=1))
    lightness = colors @ [0.3, 0.59, 0.11]
    assert (np.diff(lightness) >= 0).all() and lightness[-1] - lightness[0] > 0.5
    assert by_height(np.zeros((0, 3))).shape == (0, 3) and (by_height(np.ones((2, 3))) == colors[0]).all()
