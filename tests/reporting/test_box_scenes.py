"""Boxes among the points of a scene to turn."""

import numpy as np

from rm3d_plugin.reporting.box_scenes import DOTS, EDGES, box_view, edge_dots
from rm3d_plugin.structures import Boxes3D, PointCloud

BOXES = Boxes3D(np.array([[1.0, 2.0, 0.5, 4.0, 2.0, 1.0, 0.5], [9.0, 0, 1, 2, 2, 2, 0]]), np.array([1, 0]))


def test_dots_lie_on_the_edges():
    dots = edge_dots(BOXES).reshape(2, len(EDGES) * DOTS, 3)
    for box, own in zip(BOXES.tensor, dots, strict=True):
        turn = np.array([[np.cos(box[6]), -np.sin(box[6])], [np.sin(box[6]), np.cos(box[6])]])
        local = own - box[:3]
        local[:, :2] = local[:, :2] @ turn
        at_face = np.isclose(np.abs(local), box[3:6] / 2, atol=1e-4)
        assert (at_face.sum(axis=1) >= 2).all() and (np.abs(local) <= box[3:6] / 2 + 1e-4).all()
        assert len(np.unique(own[at_face.all(axis=1)].round(3), axis=0)) == 8
    assert edge_dots(Boxes3D.empty()).shape == (0, 3)


def test_each_set_is_shown_alone_and_with_the_others():
    cloud = PointCloud(np.random.default_rng(0).uniform(0, 5, (50, 3)))
    view = box_view('scene 1', cloud, {'truth': BOXES, 'predicted': BOXES.select(np.array([True, False]))}, ('a', 'b'))
    assert view.title == 'scene 1: 2 truth, 1 predicted'
    per_box = len(EDGES) * DOTS
    assert [layer.name for layer in view.layers] == ['all boxes', 'truth', 'predicted']
    assert len(view.xyz) == 50 + 3 * per_box
    np.testing.assert_array_equal(view.layers[0].values[50 : 50 + 2 * per_box], 0)
    expected = [-1] * 50 + [1] * per_box + [0] * per_box + [-1] * per_box
    assert view.layers[1].values.tolist() == expected
    assert view.layers[2].values.tolist() == [-1] * (50 + 2 * per_box) + [1] * per_box
