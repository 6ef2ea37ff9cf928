"""Instances without a label, on scenes small enough to count by hand."""

import numpy as np
from reference.rooms import make_room

from rm3d_plugin.experiments import scenes
from rm3d_plugin.experiments.scenes import TableScene, described_surface
from rm3d_plugin.experiments.spec import Request
from rm3d_plugin.experiments.tables import unsupervised_instances
from rm3d_plugin.experiments.tables.unsupervised_instances import merged, overlap_of, unsupervised_table
from rm3d_plugin.regions.prepare import PreparedScene
from rm3d_plugin.structures import PointCloud, RegionGraph, Regions


def three_regions():
    """Two flat regions of one colour side by side, and a third at right angles of another colour."""
    xyz = np.zeros((6, 3))
    regions = Regions(np.array([0, 0, 1, 1, 2, -1]))
    graph = RegionGraph(
        edges=np.array([[0, 1], [1, 2]]),
        sizes=np.array([2, 2, 1]),
        centroids=np.zeros((3, 3)),
        normals=np.array([[0.0, 0, 1], [0, 0, 1], [1, 0, 0]]),
        curvatures=np.array([0.0, 0.1, 0.2]),
        descriptors=np.array([[1.0, 0], [1, 0], [0, 1]]),
        extents=np.array([[1.0, 1, 0], [1, 1, 0], [3, 0.1, 0.1]]),
        colors=np.array([[50.0, 0, 0], [50, 0, 0], [90, 60, 60]]),
    )
    return PreparedScene(PointCloud(xyz, normals=np.zeros((6, 3)), curvature=np.zeros(6)), regions, graph)


def test_alike_neighbours_become_one_group_and_others_do_not():
    np.testing.assert_array_equal(merged(three_regions(), tau=1.9), [0, 0, 0, 0, 1, -1])
    np.testing.assert_array_equal(merged(three_regions(), tau=0.0), [0, 0, 0, 0, 0, -1])


def test_groups_meet_things_alone():
    scene = TableScene(
        'toy', PointCloud(np.zeros((6, 3))), np.array([2, 2, 5, 0, 0, -1]), np.array([7, 7, 8, -2, -2, -1])
    )
    found = overlap_of(scene, np.array([0, 0, 0, 1, 1, -1]))
    np.testing.assert_array_equal(found.truth_sizes, [2, 1])
    np.testing.assert_array_equal(found.sizes, [3, 2])
    np.testing.assert_array_equal(found.shared, [[2, 1], [0, 0]])
    np.testing.assert_array_equal(found.void, [0, 2])


def test_table_has_a_row_a_way_and_is_kept(tmp_path, monkeypatch):
    made = []
    for seed in (0, 1):
        xyz, truth = make_room(density=300, seed=seed)
        made.append(TableScene(f'room {seed}', described_surface(PointCloud(xyz)), truth, truth))
    toy = scenes.Collection('toy', 'toy (synthetic)', 'indoor', 20, (made[0],), (made[1],))
    monkeypatch.setitem(scenes.COLLECTIONS, 'toy', lambda root, amount: toy)
    request = Request(tmp_path, data=['toy'], scenes=1, log=lambda line: None)
    filled = unsupervised_table(request)
    rows = filled.sections[0].rows
    assert [row.name.split(',')[0] for row in rows] == ['regions', 'merged', 'merged']
    groups = [row.cells[-1].values[0] for row in rows]
    assert 0 < groups[1] < groups[0] and groups[2] <= groups[0]
    assert all(0 <= cell.values[0] <= 100 for row in rows for cell in row.cells[:-1])
    monkeypatch.setattr(unsupervised_instances, 'prepare_scene', None)
    assert unsupervised_table(request).records == filled.records, 'what was measured is read'
