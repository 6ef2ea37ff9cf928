"""One point a voxel and the way back, against a dictionary that does the same slowly."""

import numpy as np
import pytest

from rm3d_plugin.datasets.downsampled import VoxelThinner, thin_voxels


def slow(xyz, size):
    rows, kept, seen = [], [], {}
    for i, point in enumerate(xyz.astype(np.float64)):
        cell = tuple(np.floor(point / size).astype(int))
        if cell not in seen:
            seen[cell] = len(kept)
            kept.append(i)
        rows.append(seen[cell])
    return kept, rows


@pytest.mark.parametrize('shift', [0.0, 4.5e6])
def test_equals_the_slow_twin_whole_and_in_chunks(shift):
    xyz = np.random.default_rng(0).normal(scale=0.3, size=(2000, 3)) + shift
    kept, rows = slow(xyz, 0.1)
    thin = thin_voxels(xyz, 0.1)
    assert thin.kept.tolist() == kept and thin.rows.tolist() == rows
    assert (thin.kept[thin.rows[thin.kept]] == thin.kept).all()

    thinner, start, got_kept, got_rows = VoxelThinner(0.1), 0, [], []
    for size in (1, 0, 700, 3, 1296):
        part = thinner.add(xyz[start : start + size])
        got_kept += (part.kept + start).tolist()
        got_rows += part.rows.tolist()
        start += size
    assert start == thinner.seen == 2000 and len(thinner) == len(kept)
    assert got_kept == kept and got_rows == rows


def test_every_point_lies_in_the_voxel_of_its_row():
    xyz = np.random.default_rng(1).uniform(-5, 5, size=(500, 3))
    thin = thin_voxels(xyz, 1.0)
    assert (np.floor(xyz[thin.kept][thin.rows]) == np.floor(xyz)).all()


def test_none_empty_single_and_duplicates():
    xyz = np.zeros((3, 3), dtype=np.float32)
    assert thin_voxels(xyz, None).rows.tolist() == thin_voxels(xyz, None).kept.tolist() == [0, 1, 2]
    assert thin_voxels(xyz, 0.02).rows.tolist() == [0, 0, 0]
    assert thin_voxels(xyz[:1], 0.02).kept.tolist() == [0]
    assert len(thin_voxels(xyz[:0], 0.02).rows) == 0


def test_bad_sizes_and_stray_points():
    for size in (0, -1, float('nan'), float('inf')):
        with pytest.raises(ValueError, match='voxel_downsample: expected metres > 0'):
            thin_voxels(np.zeros((1, 3)), size)
    with pytest.raises(ValueError, match='remove stray points'):
        thin_voxels(np.array([[0, 0, 0], [1e6, 0, 0]]), 0.02)
