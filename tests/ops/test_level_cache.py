"""Which levels are kept, how long, and in how much memory."""

import copy

import pytest
import torch

from rm3d_plugin.models.backbones import SparseUNet
from rm3d_plugin.ops.kernel_map import KernelSpec
from rm3d_plugin.ops.level_cache import LevelCache

CUBE = KernelSpec((3, 3, 3))


def line(voxels, start=0):
    coords = torch.zeros(voxels, 4, dtype=torch.int64)
    coords[:, 3] = torch.arange(start, start + voxels)
    return coords


def test_from_the_second_time_on_a_level_and_its_maps_come_again():
    cache = LevelCache(1)
    first, second, third = (cache(line(5)) for _ in range(3))
    assert first is not second and second is third
    assert second.kernel_map(CUBE) is cache(line(5)).kernel_map(CUBE)
    assert cache(line(5, start=1)) is not third


def test_memory_is_bounded_and_the_longest_unused_goes():
    cache = LevelCache(1)
    for start in (0, 10, 20):
        for _ in range(2):
            level = cache(line(20000, start))
        level.kernel_map(CUBE)  # 0.48 MB of pairs, beside 0.8 MB of coordinates and keys
    assert cache.nbytes() > cache.limit
    assert cache(line(20000, 20)) is not level  # alone too large: gone when asked for again
    assert cache.nbytes() <= cache.limit


def test_bytes_count_maps_and_coarser_levels():
    level = LevelCache(0)(line(8))
    assert level.nbytes() == 8 * 4 * 8 + 8 * 8
    pairs = int(level.kernel_map(KernelSpec((2, 2, 2), (2, 2, 2))).starts[-1])
    assert pairs == 8
    assert level.nbytes() == 8 * 40 + 4 * 40 + pairs * 8


def test_none_are_kept_with_size_0_and_copies_start_empty():
    cache = LevelCache(0)
    assert cache(line(5)) is not cache(line(5)) and cache.nbytes() == 0
    full = LevelCache(1)
    full(line(5)), full(line(5))
    assert full.nbytes() > 0 and copy.deepcopy(full).nbytes() == 0
    with pytest.raises(ValueError, match='map_cache'):
        LevelCache(-1)


def test_a_network_computes_the_same_with_and_without():
    xyz = torch.rand(300, 3, generator=torch.Generator().manual_seed(0))
    outputs = []
    for size in (0, 16):
        torch.manual_seed(0)
        net = SparseUNet(3, 0.1, (8, 12), blocks=1, map_cache=size)
        outputs.append([net(xyz, xyz * scale, torch.tensor([0, 300])) for scale in (1.0, 2.0, 3.0)])
    assert all(torch.equal(a, b) for a, b in zip(*outputs, strict=True))
    assert net.levels.nbytes() > 0
