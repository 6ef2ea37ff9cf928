"""Regions as part of an item: the partition of the label_maker, on the rows that the pipeline keeps."""

import numpy as np
import pytest

from rm3d_plugin.datasets.transforms import pack_scene, select_points
from rm3d_plugin.descriptors import AdaptedPFH
from rm3d_plugin.inference.region_numbers import RegionNumbers, cloud_of_columns
from rm3d_plugin.oversegmentation import RegionGrowing
from rm3d_plugin.regions.prepare import prepare_scene
from rm3d_plugin.registry import TRANSFORMS
from rm3d_plugin.structures import PointCloud

SETTINGS = dict(
    descriptor=dict(type='AdaptedPFH', radius=0.4), oversegmenter=dict(type='RegionGrowing', max_edge=0.3), max_gap=0.6
)


def two_walls():
    grid = np.stack(np.meshgrid(np.arange(20), np.arange(20)), axis=-1).reshape(-1, 2) * 0.1
    wall = np.c_[grid[:, 0], np.zeros(400), grid[:, 1]]
    return np.concatenate([wall, wall + [0, 3, 0]]).astype(np.float32)


def item(points):
    return {'scene_id': 'street', 'num_points': len(points), 'points': points, 'point_index': np.arange(len(points))}


def test_the_numbers_are_those_of_the_prepared_scene(tmp_path):
    step = TRANSFORMS.build(dict(type='RegionNumbers', cache=tmp_path, **SETTINGS))
    assert isinstance(step, RegionNumbers)
    made = step(item(two_walls()))
    scene = prepare_scene(
        PointCloud(two_walls()), AdaptedPFH(radius=0.4), RegionGrowing(max_edge=0.3), max_gap=0.6, name='street'
    )
    assert np.array_equal(made['region'], scene.regions.labels)
    assert made['region'].tolist() == [0] * 400 + [1] * 400
    (stored,) = tmp_path.glob('*.npz')
    before = stored.stat().st_mtime_ns
    assert np.array_equal(RegionNumbers(tmp_path, **SETTINGS)(item(two_walls()))['region'], made['region'])
    assert stored.stat().st_mtime_ns == before  # read, not made again
    assert np.array_equal(RegionNumbers(**SETTINGS)(item(two_walls()))['region'], made['region'])

    kept = select_points(made, np.array([799, 5]))
    assert kept['region'].tolist() == [1, 0]
    assert pack_scene(kept)['data_samples'].pts_region.tolist() == [1, 0]


def test_channels_are_told_apart_by_the_number_of_columns():
    columns = np.arange(14, dtype=np.float32).reshape(2, 7)
    cloud = cloud_of_columns(columns)
    assert cloud.intensity.tolist() == [3, 10] and cloud.colors.tolist() == [[4, 5, 6], [11, 12, 13]]
    assert cloud_of_columns(columns[:, :4]).colors is None
    assert cloud_of_columns(columns[:, :6]).colors.tolist() == [[3, 4, 5], [10, 11, 12]]
    assert cloud_of_columns(columns[:, :3]).intensity is None
    with pytest.raises(ValueError, match='got 5; transforms that append columns belong behind it'):
        cloud_of_columns(columns[:, :5])
