import numpy as np
import pytest
from reference.rooms import make_room

from rm3d_plugin.descriptors import FPFH, VCCS, cosine_similarity
from rm3d_plugin.oversegmentation import VCCS as Supervoxels
from rm3d_plugin.registry import DESCRIPTORS
from rm3d_plugin.structures import PointCloud


def test_rows_are_the_mean_of_their_supervoxel():
    xyz, objects = make_room(density=250)
    cloud = PointCloud(xyz)
    base = FPFH(radius=0.25).compute(cloud)
    described = VCCS(base={'type': 'FPFH', 'radius': 0.25}, voxel_size=0.1, seed_size=0.5).compute(cloud)
    regions = Supervoxels(voxel_size=0.1, seed_size=0.5).segment(cloud, base)
    assert described.values.shape == (len(xyz), 33) and described.valid.all()
    np.testing.assert_allclose(described.values.sum(axis=1), 1, atol=1e-5)
    for region in range(0, len(regions), 7):
        points = regions.points_of(region)
        rows = described.values[points]
        assert (rows == rows[0]).all()
        mean = base.values[points[base.valid[points]]].astype(np.float64).mean(axis=0)
        np.testing.assert_allclose(rows[0], mean / mean.sum(), atol=1e-6)
    floor, ball = described.values[objects == 0], described.values[objects == 6]
    alike = cosine_similarity(floor[:1], floor[50:51])[0]
    assert alike > cosine_similarity(floor[:1], ball[:1])[0]


def test_colour_divides_what_shape_does_not():
    rng = np.random.default_rng(0)
    xyz = np.c_[rng.uniform(0, 2, (2000, 2)), np.zeros(2000)]
    xyz = xyz[np.abs(xyz[:, 0] - 1) > 0.05]  # no voxel holds both colours
    side = xyz[:, 0] > 1
    colors = np.where(side[:, None], np.float32([1, 0, 0]), np.float32([0, 0, 1])).astype(np.float32)
    options = dict(base={'type': 'SuperpointGraph'}, voxel_size=0.1, seed_size=0.4, color_weight=10.0)
    rows = VCCS(**options).compute(PointCloud(xyz, colors=colors)).values
    assert not {row.tobytes() for row in rows[side]} & {row.tobytes() for row in rows[~side]}


def test_empty_single_and_duplicate_points():
    for xyz in (np.zeros((0, 3)), np.zeros((1, 3)), np.ones((5, 3))):
        described = VCCS().compute(PointCloud(xyz))
        assert described.values.shape == (len(xyz), 33) and not described.valid.any() and not described.values.any()


def test_wrong_input_is_named():
    with pytest.raises(ValueError, match='seed_size > voxel_size'):
        DESCRIPTORS.build(dict(type='VCCS', voxel_size=1.0))
    with pytest.raises(ValueError, match='weights >= 0'):
        VCCS(shape_weight=-1.0)
