import numpy as np
import pytest
from reference import growing
from reference.kitti_frames import frames, read_frame
from reference.rooms import make_room

from rm3d_plugin.descriptors import AdaptedPFH
from rm3d_plugin.ops.segment import segment_majority
from rm3d_plugin.oversegmentation import RegionGrowing
from rm3d_plugin.oversegmentation.region_growing import link_points, seed_order, without_color_steps
from rm3d_plugin.oversegmentation.small_regions import (
    Affinity,
    absorb_small,
    drop_small,
    pair_affinity,
    unit_descriptors,
)
from rm3d_plugin.registry import OVERSEGMENTERS
from rm3d_plugin.structures import Descriptors, PointCloud

NO_DESCRIPTOR = {'min_region': 1}


def described(values, valid=None):
    values = np.asarray(values, dtype=np.float32)
    return Descriptors(values, np.ones(len(values), dtype=bool) if valid is None else np.asarray(valid))


def random_scene(seed, n=120, features=4):
    """Patchy normals and descriptors, so that both conditions pass and fail often."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 1, (n, 3)).astype(np.float32)
    patch = (xyz[:, 0] > 0.5).astype(int) + 2 * (xyz[:, 1] > 0.5)
    normals = rng.normal(size=(4, 3))[patch] + rng.normal(0, 0.3, (n, 3))
    normals *= rng.choice([-1.0, 1.0], (n, 1)) / np.linalg.norm(normals, axis=1, keepdims=True)
    values = rng.uniform(0, 1, (4, features))[patch] + rng.uniform(0, 0.3, (n, features))
    curvature = np.round(rng.uniform(0, 0.06, n), 2).astype(np.float32)  # rounded: many ties
    cloud = PointCloud(xyz, normals=normals.astype(np.float32), curvature=curvature, sensor=(0.5, 0.5, -1.0))
    return cloud, described(values, rng.uniform(size=n) > 0.1), rng.choice(n, 5, replace=False)


def line(n=6, step=0.1):
    """Points along x with one normal."""
    xyz = np.c_[np.arange(n) * step, np.zeros(n), np.zeros(n)]
    return xyz, np.tile([0.0, 0.0, 1.0], (n, 1)), np.zeros(n)


def same_partition(a, b):
    pairs = set(zip(np.asarray(a).tolist(), np.asarray(b).tolist(), strict=True))
    return len(pairs) == len(set(a)) == len(set(b))


@pytest.mark.parametrize('seed', range(6))
def test_growing_equals_the_algorithm_written_out(seed):
    cloud, descriptors, seeds = random_scene(seed)
    segmenter = RegionGrowing(zeta=0.02, neighbors=7, min_region=1, max_edge=0.2, range_growth=0.05)
    labels = segmenter.partition(cloud, descriptors, seeds)
    reach = 0.2 + 0.05 * np.linalg.norm(cloud.xyz - np.array([0.5, 0.5, -1.0]), axis=1)
    values = np.where(descriptors.valid[:, None], descriptors.values, 0.0)
    expected = growing.grow(
        cloud.xyz.astype(float).tolist(),
        cloud.normals.tolist(),
        values.tolist(),
        cloud.curvature.tolist(),
        seeds.tolist(),
        neighbors=7,
        reach=reach,
        threshold=0.8,
        zeta=0.02,
    )
    assert 5 < len(set(expected)) < 110
    assert labels.tolist() == expected


def test_condition_1_compares_normals_whatever_their_sign():
    xyz, normals, curvature = line()
    normals[1::2] *= -1
    normals[3:] = [1.0, 0.0, 0.0]
    cloud = PointCloud(xyz, normals=normals, curvature=curvature)
    labels = RegionGrowing(**NO_DESCRIPTOR).partition(cloud, described(np.ones((6, 2)), np.zeros(6, dtype=bool)))
    assert same_partition(labels, [0, 0, 0, 1, 1, 1])


def test_affinity_by_hand():
    """Normals at 60 degrees and equal descriptors: sqrt((.25 + 1) / 2); as printed: sqrt(1.25)."""
    normals = np.array([[0, 0, 1.0], [0, np.sin(np.pi / 3), 0.5], [0, 0, 0]])
    values = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    pairs = np.array([[0, 1], [0, 2]])
    np.testing.assert_allclose(pair_affinity(normals, values, pairs, Affinity()), [np.sqrt(0.625), 0.0])
    printed = pair_affinity(normals, values, pairs, Affinity(normalised=False))
    np.testing.assert_allclose(printed, [np.sqrt(1.25), 0.0])
    weighted = pair_affinity(normals, values, pairs, Affinity(3.0, 1.0))
    np.testing.assert_allclose(weighted, [np.sqrt((3 * 0.25 + 1) / 4), 0.0])


def test_points_that_are_not_described_join_by_their_normals():
    xyz, normals, curvature = line()
    cloud = PointCloud(xyz, normals=normals, curvature=curvature)
    values = np.zeros((6, 2))
    values[:3, 0] = values[3:, 1] = 1.0
    segmenter = RegionGrowing(neighbors=2, **NO_DESCRIPTOR)
    assert same_partition(segmenter.partition(cloud, described(values)), [0, 0, 0, 1, 1, 1])
    unknown = described(values, [True, True, True, False, True, True])
    assert same_partition(segmenter.partition(cloud, unknown), [0] * 6)  # point 3 bridges the two


def test_condition_2_stops_a_point_that_joined_from_growing():
    xyz, normals, curvature = line(7)
    curvature[3] = 0.05
    cloud = PointCloud(xyz, normals=normals, curvature=curvature)
    values = described(np.ones((7, 1)))
    segmenter = RegionGrowing(neighbors=2, zeta=0.02, **NO_DESCRIPTOR)
    assert segmenter.partition(cloud, values).tolist() == [0, 0, 0, 0, 1, 1, 1]
    assert segmenter.partition(cloud, values, np.array([6])).tolist() == [1, 1, 1, 0, 0, 0, 0]
    assert RegionGrowing(neighbors=2, zeta=0.06, min_region=1).partition(cloud, values).tolist() == [0] * 7


def test_labelled_points_are_seeds_before_flat_ones():
    curvature = np.array([0.3, 0.1, 0.1, 0.0])
    assert seed_order(curvature, None).tolist() == [3, 1, 2, 0]
    assert seed_order(curvature, np.array([0, 2])).tolist() == [2, 0, 3, 1]


def test_a_gap_is_never_crossed_and_grows_with_range():
    xyz, normals, curvature = line(4, step=0.1)
    far = xyz + [10.0, 0.0, 0.0]
    spread = far * [3.0, 1.0, 1.0] - [20.0, 0.0, 0.0]  # 0.3 m apart from 10 m on
    xyz = np.concatenate([xyz, spread])
    cloud = PointCloud(xyz, normals=np.tile(normals, (2, 1)), curvature=np.tile(curvature, 2), sensor=(0.0, 0.0, 0.0))
    values = described(np.ones((8, 1)))
    alone = RegionGrowing(max_edge=0.15, min_region=4).partition(cloud, values)
    assert same_partition(alone, [0, 0, 0, 0, 1, 2, 3, 4])  # too small to stay, but nobody is near
    joined = RegionGrowing(max_edge=0.15, range_growth=0.02, min_region=4).partition(cloud, values)
    assert same_partition(joined, [0, 0, 0, 0, 1, 1, 1, 1])


def test_regions_end_at_an_edge_of_colour():
    xyz, normals, curvature = line()
    shading = np.linspace(0.4, 0.6, 6)  # light that fades along the wall is no edge
    colors = np.c_[shading, shading, shading]
    colors[2:4] = [0.9, 0.1, 0.1]
    cloud = PointCloud(xyz, normals=normals, curvature=curvature, colors=colors)
    flat = described(np.ones((6, 2)))
    options = NO_DESCRIPTOR | {'neighbors': 2, 'max_edge': 0.15}
    assert RegionGrowing(**options).partition(cloud, flat).tolist() == [0] * 6
    assert RegionGrowing(max_color_step=0.2, **options).partition(cloud, flat).tolist() == [0, 0, 1, 1, 2, 2]
    grey = PointCloud(xyz, normals=normals, curvature=curvature)
    assert RegionGrowing(max_color_step=0.2, **options).partition(grey, flat).tolist() == [0] * 6
    with pytest.raises(ValueError, match='max_color_step'):
        RegionGrowing(max_color_step=0.0)


def test_colour_steps_as_written_out():
    cloud, descriptors, _ = random_scene(3)
    colors = np.random.default_rng(99).random((len(cloud), 3))
    reach = np.full(len(cloud), 0.3)
    links = link_points(
        cloud.xyz, cloud.normals, unit_descriptors(descriptors), 6, reach, 0.5, Affinity(1.0, 1.0, True)
    )
    cut = without_color_steps(links, colors, 0.6)
    for i, row in enumerate(links.neighbors):
        for j, other in enumerate(row):
            near = other >= 0 and float(np.sqrt(np.square(colors[i] - colors[other]).sum())) <= 0.6
            assert cut.joins[i, j] == (links.joins[i, j] and near)
    assert 0 < cut.joins.sum() < links.joins.sum()


def test_small_regions_go_to_the_most_affine_neighbour():
    labels = np.array([0, 0, 0, 1, 2, 2, 2])
    neighbors = np.array([[1, -1], [2, 0], [3, 1], [2, 4], [3, 5], [4, 6], [5, -1]])
    normals = np.array([[0, 0, 1.0]] * 3 + [[0, 0.1, 1.0]] + [[0, 1.0, 0]] * 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    values = unit_descriptors(described(np.ones((7, 1))))
    assert absorb_small(labels, neighbors, normals, values, 3, Affinity()).tolist() == [0, 0, 0, 0, 1, 1, 1]
    normals[3] = [0, 1.0, 0.1]
    assert absorb_small(labels, neighbors, normals, values, 3, Affinity()).tolist() == [0, 0, 0, 1, 1, 1, 1]
    normals[3] = [0, 1.0, 1.0]
    normals[3] /= np.sqrt(2)  # a tie goes to the lower number
    assert absorb_small(labels, neighbors, normals, values, 3, Affinity()).tolist() == [0, 0, 0, 0, 1, 1, 1]
    assert absorb_small(labels, neighbors, normals, values, 1, Affinity()).tolist() == labels.tolist()


def test_small_regions_are_dropped_on_request():
    labels = np.array([0, 0, 0, 1, 2, 2, -1])
    assert drop_small(labels, 2).tolist() == [0, 0, 0, -1, 2, 2, -1]
    assert drop_small(labels, 4).tolist() == [-1] * 7
    assert drop_small(np.zeros(0, dtype=np.int64), 4).tolist() == []
    cloud, descriptors, _ = random_scene(1)
    regions = RegionGrowing(neighbors=7, max_edge=0.2, min_region=1, drop_below=10).segment(cloud, descriptors)
    assert (regions.sizes >= 10).all() and (regions.labels == -1).any()


def test_normals_are_estimated_where_the_cloud_has_none():
    rng = np.random.default_rng(0)
    flat = np.c_[rng.uniform(0, 1, (400, 2)), np.zeros(400)]
    wall = flat[:, [2, 0, 1]] + [2.0, 0.0, 0.5]
    cloud = PointCloud(np.concatenate([flat, wall]))
    regions = RegionGrowing().segment(cloud, described(np.ones((800, 1))))
    assert regions.labels.tolist() == [0] * 400 + [1] * 400


def test_order_of_points_does_not_matter_without_ties():
    cloud, descriptors, _ = random_scene(3)
    rng = np.random.default_rng(0)
    cloud = PointCloud(cloud.xyz, normals=cloud.normals, curvature=rng.uniform(0, 0.06, len(cloud)))
    order = rng.permutation(len(cloud))
    segmenter = RegionGrowing(neighbors=7, min_region=1)
    whole = segmenter.segment(cloud, descriptors)
    other = segmenter.segment(cloud.select(order), Descriptors(descriptors.values[order], descriptors.valid[order]))
    assert same_partition(other.labels, whole.labels[order])


@pytest.mark.parametrize('n', [0, 1, 2])
def test_very_few_points(n):
    cloud = PointCloud(np.zeros((n, 3)))
    regions = RegionGrowing().segment(cloud, described(np.ones((n, 3))))
    assert regions.labels.tolist() in ([0] * n, list(range(n)))


def test_copies_of_one_point():
    cloud = PointCloud(np.zeros((50, 3)), normals=np.tile([0, 0, 1.0], (50, 1)), curvature=np.zeros(50))
    assert len(RegionGrowing(neighbors=4).segment(cloud, described(np.ones((50, 2))))) >= 1


def test_room_is_split_along_its_objects():
    xyz, truth = make_room()
    cloud = PointCloud(xyz)
    descriptors = AdaptedPFH(radius=0.1).compute(cloud)
    regions = RegionGrowing.preset('indoor').segment(cloud, descriptors)
    majority = segment_majority(truth, regions.labels, len(regions))
    assert (majority[regions.labels] == truth).mean() >= 0.95
    assert len(regions) < 60
    printed = RegionGrowing(theta=60.0, normalise_affinity=False).segment(cloud, descriptors)
    majority = segment_majority(truth, printed.labels, len(printed))
    assert (majority[printed.labels] == truth).mean() < 0.8  # the formula as printed runs over edges


def test_real_street_objects_fall_into_few_pure_regions(real_data):
    right = points = parts = objects = 0
    for name in frames(real_data)[-4:]:
        scan = read_frame(real_data, name)
        cloud = PointCloud(scan.xyz, sensor=(0.0, 0.0, 0.0))
        descriptors = AdaptedPFH.preset('lidar').compute(cloud)
        regions = RegionGrowing.preset('lidar').segment(cloud, descriptors)
        kept = regions.labels >= 0
        majority = segment_majority(scan.instance + 1, regions.labels, len(regions)) - 1
        inside = kept & (scan.instance >= 0)
        right += (majority[regions.labels[inside]] == scan.instance[inside]).sum()
        points += inside.sum()
        for instance in np.unique(scan.instance[inside]):
            mine = regions.labels[kept & (scan.instance == instance)]
            if len(mine) >= 50:
                share = np.sort(np.bincount(mine))[::-1].cumsum() / len(mine)
                parts += int(np.searchsorted(share, 0.9)) + 1
                objects += 1
    assert right / points > 0.97
    assert objects > 15 and parts / objects < 3.0


def test_is_built_from_a_config():
    segmenter = OVERSEGMENTERS.build(dict(type='RegionGrowing', theta=60.0, ground=dict(cell=0.5)))
    assert segmenter.threshold == pytest.approx(0.5)
    assert segmenter.ground == {'cell': 0.5}
    with pytest.raises(ValueError, match=r'zeta >= 0'):
        RegionGrowing(zeta=-1.0)
    with pytest.raises(ValueError, match="'indoor', 'lidar'"):
        RegionGrowing.preset('boat')
