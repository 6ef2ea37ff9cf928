"""Scans that teach one another, by the benchmark's own rows."""

import numpy as np

from rm3d_plugin.experiments.benchmarks.propagate_clicks import Scan
from rm3d_plugin.experiments.benchmarks.propagate_together import rows_of, with_same_channels
from rm3d_plugin.structures import PointCloud


def steps(seed, name, colours):
    """A floor, a wall and a shelf of 1,500 points."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 3, (1500, 3))
    semantic = np.repeat([0, 1, 2], 500)
    xyz[semantic == 0, 2], xyz[semantic == 1, 0], xyz[semantic == 2, 2] = 0.0, 0.0, 1.5
    cloud = PointCloud(xyz.astype(np.float32), colors=rng.random((1500, 3)) if colours else None)
    return Scan(name, cloud, semantic)


def test_channels_that_some_lack_are_left_out_of_all():
    mixed = with_same_channels([steps(0, 'a', True), steps(1, 'b', False)])
    assert [scan.cloud.colors for scan in mixed] == [None, None]
    alike = with_same_channels([steps(0, 'a', True), steps(1, 'b', True)])
    assert all(scan.cloud.colors is not None for scan in alike)


def test_a_row_has_the_means_of_the_scans():
    rows = dict(rows_of([steps(0, 'a', True), steps(1, 'b', False)], [0]))
    assert list(rows) == ['one a class, seed 0', 'twenty a scan, seed 0']
    for row in rows.values():
        assert row['scans'] == 2 and row['nearest_miou'] < row['together_miou'] <= 100
    assert rows['twenty a scan, seed 0']['nearest_miou'] > rows['one a class, seed 0']['nearest_miou']
