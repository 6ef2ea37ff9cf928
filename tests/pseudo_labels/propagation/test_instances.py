import numpy as np

from rm3d_plugin.pseudo_labels.propagation import prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.instances import pieces, spread_instances
from rm3d_plugin.structures import PointCloud


def three_boxes(rng):
    """Two boxes that touch, and one apart; classes all 0, their numbers."""
    starts = np.array([[0.0, 0, 0], [1.0, 0, 0], [5.0, 0, 0]])
    number = np.repeat(np.arange(3), 400)
    return rng.uniform(0, 1, (1200, 3)) + starts[number], number


def test_instances_spread_in_the_piece_where_they_are_labelled():
    xyz, number = three_boxes(np.random.default_rng(0))
    scene, semantic = prepare_cloud(PointCloud(xyz)), np.zeros(1200, dtype=np.int64)
    annotated = np.full(1200, -1)
    for own, place in ((0, 0.1), (1, 1.9)):
        nearest = np.abs(xyz - [place, 0.5, 0.5]).sum(axis=1).argmin()
        annotated[nearest] = 7 + own
    found = spread_instances(scene, semantic, annotated)
    assert (found[number == 2] == -1).all()  # nobody labelled it
    assert np.mean(found[number < 2] == 7 + number[number < 2]) > 0.85


def test_unknown_points_are_no_part_of_a_piece():
    xyz, number = three_boxes(np.random.default_rng(0))
    scene = prepare_cloud(PointCloud(xyz))
    semantic = np.where(number == 2, -1, 0)
    piece = pieces(scene.graphs[0], semantic)
    assert len(np.unique(piece[number == 2])) == 400
    assert len(np.unique(piece[number < 2])) == 1


def test_nothing_labelled_nothing_spreads():
    xyz, _ = three_boxes(np.random.default_rng(0))
    scene = prepare_cloud(PointCloud(xyz))
    assert (spread_instances(scene, np.zeros(1200, np.int64), np.full(1200, -1)) == -1).all()
