import numpy as np
import pytest
from reference.rooms import make_room
from reference.vccs_slow import slow_vccs
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.ops.color import rgb_to_lab
from rm3d_plugin.ops.supervoxels import (
    CORNER,
    VoxelDistance,
    VoxelFeatures,
    from_corner,
    grow_supervoxels,
    seed_voxels,
    supervoxels,
)
from rm3d_plugin.ops.voxel_grid import voxel_grid, voxel_neighbors
from rm3d_plugin.oversegmentation import VCCS
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud, Regions


def flat(cloud, bins=4):
    """The same histogram everywhere."""
    return Descriptors(np.full((len(cloud), bins), 0.25, dtype=np.float32), np.ones(len(cloud), dtype=bool))


def plane(count=600, width=2.0, seed=0):
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(0, width, (count, 2)), np.zeros(count)].astype(np.float32)


@pytest.mark.parametrize('seed', [0, 1])
def test_equals_the_slow_twin(seed):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (700, 3)).astype(np.float32) * np.float32([1, 1, 0.2])
    colors = rng.uniform(0, 1, (700, 3)).astype(np.float32)
    histograms = rng.uniform(0, 1, (700, 6)).astype(np.float32)
    histograms[:50] = 0  # not described
    got = supervoxels(xyz, rgb_to_lab(colors), None, histograms, 0.13, 0.5, VoxelDistance(), discard_unreached=True)
    want = slow_vccs(xyz, rgb_to_lab(colors), histograms, 0.13, 0.5)
    assert len(Regions(got.labels)) > 10
    np.testing.assert_array_equal(Regions(got.labels).labels, Regions(want).labels)
    valid = histograms.any(axis=1)
    segmenter = VCCS(voxel_size=0.13, seed_size=0.5, discard_unreached=True)
    regions = segmenter.segment(PointCloud(xyz, colors=colors), Descriptors(histograms, valid))
    np.testing.assert_array_equal(regions.labels, Regions(want).labels)


def test_voxels_and_their_neighbours():
    points = np.array([[0.05, 0, 0], [-0.05, 0, 0], [0.08, 0.01, 0], [0.35, 0, 0], [0.15, 0.15, 0.15]])
    grid = voxel_grid(points, 0.1)
    assert grid.coords.tolist() == [[1, 1, 1], [2, 1, 1], [3, 2, 2], [5, 1, 1]]
    assert grid.point_to_voxel.tolist() == [1, 0, 1, 3, 2]
    near = [set(row[row >= 0].tolist()) for row in voxel_neighbors(grid.coords)]
    assert near == [{1}, {0, 2}, {1}, set()]


def test_neighbours_do_not_run_over_an_axis():
    # The last cell of one row and the first of the next are far apart however they are numbered.
    coords = np.array([[1, 1, 2**20 - 2], [1, 2, 1], [1, 2, 2]])
    assert [row[row >= 0].tolist() for row in voxel_neighbors(coords)] == [[], [2], [1]]


def test_a_cloud_of_any_width_keeps_its_neighbours(monkeypatch):
    points = np.array([[0.0, 0, 0], [0.1, 0, 0], [1e6, 0, 0], [1e6, 0.1, 0], [1e6, 0.3, 0]]) + 0.05
    grid = voxel_grid(points, 0.1)
    assert grid.coords.tolist() == [[1, 1, 1], [2, 1, 1], [4, 1, 1], [4, 2, 1], [4, 4, 1]]
    near = [set(row[row >= 0].tolist()) for row in voxel_neighbors(grid.coords)]
    assert near == [{1}, {0}, {3}, {2}, set()]
    monkeypatch.setattr('rm3d_plugin.ops.voxel_grid.AXIS_BITS', 3)
    with pytest.raises(ValueError, match='voxels of 0.1 m wide'):
        voxel_grid(np.arange(24.0).reshape(8, 3), 0.1)


def test_a_seed_with_too_few_voxels_around_it_is_rejected():
    # Least number: 0.05 pi (1 / 2)^2 / 0.1^2 = 3.9, so four voxels pass and three do not.
    three = np.array([[0.45, 0.5, 0.5], [0.55, 0.5, 0.5], [0.65, 0.5, 0.5]])
    assert seed_voxels(three, 1.0, 0.1).tolist() == []
    four = np.concatenate([three, [[0.75, 0.5, 0.5]]])
    assert seed_voxels(four, 1.0, 0.1).tolist() == [0]  # 0 and 1 are equally near the cell's centre
    far = np.concatenate([three, [[0.99, 0.99, 0.5]]])
    assert seed_voxels(far, 1.0, 0.1).tolist() == []


def row_of_voxels(values, neighbors=None):
    count = len(values)
    near = np.full((count, 26), -1)
    near[1:, 0], near[:-1, 1] = np.arange(count - 1), np.arange(1, count)
    xyz = np.c_[np.arange(count, dtype=float), np.zeros((count, 2))]
    histograms = np.stack([1 - np.asarray(values, dtype=float), np.asarray(values, dtype=float)], axis=1)
    return VoxelFeatures(xyz, np.zeros((count, 0)), np.zeros((count, 0)), histograms), near


def test_a_nearer_centre_takes_a_voxel_over():
    # Shape 0 0 0 1 1 1 1; both seeds reach voxel 2 and the second, nearer in space at first, keeps what it is like.
    features, near = row_of_voxels([0, 0, 0, 1, 1, 1, 1])
    alike = VoxelDistance(spatial=1e-3)
    one = grow_supervoxels(features, near, np.array([0, 3]), 3.0, 1, alike)
    assert one.tolist() == [0, 0, 1, 1, 1, -1, -1]
    two = grow_supervoxels(features, near, np.array([0, 3]), 3.0, 2, alike)
    assert two.tolist() == [0, 0, 0, 1, 1, 1, -1]
    space_only = VoxelDistance(shape=0.0)
    assert grow_supervoxels(features, near, np.array([0, 3]), 3.0, 9, space_only).tolist() == [0, 0, 0, 1, 1, 1, 1]


def test_growth_ends_after_the_rings_and_in_gaps():
    xyz = np.c_[np.arange(0.05, 6, 0.1), np.zeros((60, 2))].astype(np.float32)
    features, near = row_of_voxels(np.zeros(60))
    owner = grow_supervoxels(features, near, np.array([0]), 3.0, 7, VoxelDistance())
    assert (owner >= 0).sum() == 8
    xyz = xyz[(xyz[:, 0] < 2) | (xyz[:, 0] > 4)]
    labels = supervoxels(xyz, None, None, None, 0.1, 0.8, VoxelDistance()).labels
    assert not set(labels[:20]) & set(labels[20:])


def test_edges_of_colour_and_of_shape_are_kept():
    xyz = plane(2000)
    xyz = xyz[np.abs(xyz[:, 0] - 1.0) > 0.05]  # no voxel holds both
    side = xyz[:, 0] > 1.0
    colors = np.where(side[:, None], np.float32([1, 0, 0]), np.float32([0, 0, 1])).astype(np.float32)
    cloud = PointCloud(xyz, colors=colors)
    for distance in ('papon', 'pcl'):
        segmenter = VCCS(voxel_size=0.1, seed_size=0.4, distance=distance, color_weight=10.0)
        labels = segmenter.segment(cloud, flat(cloud)).labels
        assert not set(labels[side]) & set(labels[~side])
    histograms = np.where(side[:, None], np.float32([1, 0]), np.float32([0, 1])).astype(np.float32)
    described = Descriptors(histograms, np.ones(len(xyz), dtype=bool))
    labels = VCCS(voxel_size=0.1, seed_size=0.4).segment(PointCloud(xyz), described).labels
    assert not set(labels[side]) & set(labels[~side])


def test_pcl_distance_uses_normals_of_either_sign():
    floor, wall = plane(1500), plane(1500, seed=1)
    up = np.float32([-0.6, 0, 0.8])  # leans outwards: at a right angle no sign would be the better one
    xyz = np.concatenate([floor, wall[:, :1] * up + wall[:, 1:2] * np.float32([0, 1, 0])])
    normals = np.repeat(np.float32([[0, 0, 1], [0.8, 0, 0.6]]), 1500, axis=0)
    signs = np.where(np.random.default_rng(0).uniform(size=len(xyz)) < 0.5, -1, 1).astype(np.float32)
    segmenter = VCCS(voxel_size=0.1, seed_size=0.5, distance='pcl')
    straight, turned = (PointCloud(xyz, normals=n) for n in (normals, normals * signs[:, None]))
    labels = segmenter.segment(straight, flat(straight)).labels
    np.testing.assert_array_equal(labels, segmenter.segment(turned, flat(turned)).labels)
    regions = Regions(labels)
    is_wall = np.arange(len(xyz)) >= 1500
    pure = sum(
        max(is_wall[regions.points_of(r)].sum(), (~is_wall[regions.points_of(r)]).sum()) for r in range(len(regions))
    )
    assert pure > 0.97 * len(xyz)


def test_rounding_makes_no_distance_negative():
    # A voxel at its own centre; the normal's length is 1 + 2e-16, so that 1 - |n.n| is below 0.
    long = np.array([0.0, 0.0, 1.0 + 2.3e-16])
    assert long @ long > 1
    here = VoxelFeatures(np.zeros((2, 3)), np.zeros((2, 0)), np.stack([long, long]), np.zeros((2, 0)))
    near = np.array([[1], [0]])
    assert grow_supervoxels(here, near, np.array([0, 1]), 1.0, 3, VoxelDistance('pcl')).tolist() == [0, 1]


def test_a_room_falls_into_pure_connected_supervoxels():
    xyz, objects = make_room()
    cloud = PointCloud(xyz)
    regions = VCCS(distance='pcl').segment(cloud, flat(cloud))
    assert 400 < len(regions) < 900
    pure = sum(np.bincount(objects[regions.points_of(r)]).max() for r in range(len(regions)))
    assert pure > 0.97 * len(xyz)
    again = VCCS(distance='pcl').segment(cloud, flat(cloud))
    np.testing.assert_array_equal(regions.labels, again.labels)
    grid = voxel_grid(from_corner(cloud.xyz) + CORNER * 0.05, 0.05)
    near = voxel_neighbors(grid.coords)
    owner = np.full(len(grid.coords), -1)
    owner[grid.point_to_voxel] = regions.labels
    rows, slots = np.nonzero(near >= 0)
    same = owner[rows] == owner[near[rows, slots]]
    graph = coo_array((np.ones(same.sum()), (rows[same], near[rows, slots][same])), shape=(len(owner), len(owner)))
    assert connected_components(graph, directed=False)[0] < 1.02 * len(regions)  # takeovers may cut some in two


def test_order_of_the_points_does_not_matter():
    xyz = plane(800)
    order = np.random.default_rng(3).permutation(len(xyz))
    segmenter = VCCS(voxel_size=0.1, seed_size=0.4)
    straight, mixed = PointCloud(xyz), PointCloud(xyz[order])
    labels = segmenter.segment(straight, flat(straight)).labels
    other = segmenter.segment(mixed, flat(mixed)).labels
    np.testing.assert_array_equal(Regions(labels[order]).labels, other)


def lattice():
    steps = np.arange(40) * 0.025
    return np.stack(np.meshgrid(steps, steps, [0, 0.5]), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize('shift', [0.025, (0.025, 0.0, 0.0), (0.3, 1.7, -0.4), (12.345, -6.78, 1.1)])
@pytest.mark.parametrize('distance', ['papon', 'pcl'])
def test_a_moved_cloud_has_the_same_supervoxels(distance, shift):
    segmenter = VCCS(distance=distance)
    for xyz in (make_room()[0][::3], plane(2000), lattice()):
        still, moved = PointCloud(xyz.astype(np.float32)), PointCloud((xyz + shift).astype(np.float32))
        labels = segmenter.segment(still, flat(still)).labels
        np.testing.assert_array_equal(segmenter.segment(moved, flat(moved)).labels, labels)


def test_unreached_points_are_kept_or_discarded():
    xyz = np.concatenate([plane(1500), [[5, 5, 5], [5.01, 5, 5], [9, 9, 9]]]).astype(np.float32)
    cloud = PointCloud(xyz)
    labels = VCCS(voxel_size=0.1, seed_size=1.0).segment(cloud, flat(cloud)).labels
    assert labels[-3] == labels[-2] != labels[-1] and labels.min() == 0
    assert not set(labels[-3:]) & set(labels[:-3])
    labels = VCCS(voxel_size=0.1, seed_size=1.0, discard_unreached=True).segment(cloud, flat(cloud)).labels
    assert labels[-3:].tolist() == [-1, -1, -1] and labels[:-3].min() == 0


def test_empty_single_and_duplicate_points():
    for xyz in (np.zeros((0, 3)), np.zeros((1, 3)), np.ones((5, 3))):
        cloud = PointCloud(xyz)
        for distance in ('papon', 'pcl'):
            assert VCCS(distance=distance).segment(cloud, flat(cloud)).labels.tolist() == [0] * len(xyz)


def test_wrong_input_is_named():
    with pytest.raises(ValueError, match='seed_size > voxel_size > 0'):
        VCCS(voxel_size=0.3, seed_size=0.3)
    with pytest.raises(ValueError, match="expected one of .'papon', 'pcl'., got 'slic'"):
        OVERSEGMENTERS.build(dict(type='VCCS', distance='slic'))
    with pytest.raises(ValueError, match='weights >= 0'):
        VCCS(shape_weight=-1)
    cloud = PointCloud(plane(10))
    signed = Descriptors(np.full((10, 2), -1, dtype=np.float32), np.ones(10, dtype=bool))
    with pytest.raises(ValueError, match='histogram intersection needs descriptors >= 0'):
        VCCS().segment(cloud, signed)
    VCCS(distance='pcl').segment(cloud, signed)
