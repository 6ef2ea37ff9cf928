"""The benchmark command: runs, counts operations as by hand, writes what it prints."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from runs import tiny_runs

from rm3d_plugin.commands.bench import main
from rm3d_plugin.user_error import ConfigError


def _bench(folder, arguments):
    os.environ['PCL_ROOT'] = str(folder)
    tiny_runs.command('bench', folder, arguments)


def bench(tmp_path, *arguments, repeats=1, out='out.json'):
    """Run a benchmark where no C++ peer can be found, and read its numbers."""
    words = [*arguments, '--repeats', str(repeats), '--json', str(tmp_path / out)]
    code, printed = tiny_runs.run(tmp_path / 'log.txt', _bench, tmp_path, words)
    assert code == 0, printed
    result = json.loads((tmp_path / out).read_text())
    assert printed.endswith(json.dumps(result, indent=2) + '\n')
    return result


def test_sparse_unet(tmp_path):
    arguments = ['sparse-unet', '--voxels', '300', '--channels', '4', '--blocks', '1', '--backward']
    result = bench(tmp_path, *arguments, repeats=2, out=Path('sub') / 'unet.json')
    assert abs(result['voxels'] - 300) <= 15
    pairs = round(result['active_neighbours'] * result['voxels'])
    convolutions = 3  # the stem and two of the block, 4 -> 4 channels each
    assert abs(result['flops'] / (2 * 16 * convolutions) - pairs) <= 0.005 * result['voxels'] + 1
    assert result['forward_backward_flops'] == 3 * result['flops']
    assert all(result[key] > 0 for key in ('forward_s', 'forward_backward_s', 'gemm_gflops', 'forward_share_of_gemm'))
    assert result['machine']['torch_threads'] == 1


def test_octree(tmp_path):
    result = bench(tmp_path, 'octree', '--points', '3000', '--rule-queries', '10')
    assert abs(result['neighbors'] - 30) < 1 and result['point_order'] == 'random'
    assert set(result['rows_that_differ'].values()) == {0}
    assert result['absent'] == [f'{name}: not available' for name in ('nanoflann', 'pcl_octree', 'linked_octree')]
    rules = result['rules']
    assert rules['all']['visits'] < rules['skip_disjoint']['visits'] <= rules['none']['visits']
    assert rules['all, every point, in groups']['visits'] < rules['all, every point']['visits']


def test_a_descriptor_and_an_over_segmenter(tmp_path):
    result = bench(tmp_path, 'fpfh', '--points', '2000')
    assert 'pcl: not available' in result['absent']
    assert all(share == 1.0 for share in result['share_of_equal_rows'].values())
    result = bench(tmp_path, 'region-growing', '--points', '3000')
    assert result['seconds']['rm3d']['times_ours'] == 1.0 and result['regions']['rm3d'] > 1


def test_prepare_measures_each_size_in_its_own_process(tmp_path):
    result = bench(tmp_path, 'prepare', '--sizes', '1500', '3000')
    assert [scene['points'] for scene in result['scenes']] == [1500, 3000]
    assert all(scene['peak_rss_gib'] > 0.1 and scene['regions'] > 1 for scene in result['scenes'])
    assert isinstance(result['exponent'], float)


def test_descriptors_each_in_its_own_process(tmp_path):
    result = bench(tmp_path, 'describe', '--points', '3000', '--descriptors', 'FPFH', 'SupervisedSuperpoint')
    assert {name: found['values'] for name, found in result['descriptors'].items()} == {
        'FPFH': 33, 'SupervisedSuperpoint': 4
    }  # fmt: skip
    assert all(0.1 < found['peak_rss_gib'] < 4 and found['described'] > 0.3 for found in result['descriptors'].values())
    with pytest.raises(ConfigError, match='--descriptors: expected some of .*; got SHOUT'):
        main(['describe', '--points', '100', '--descriptors', 'SHOUT'])


@pytest.mark.slow
def test_a_large_scene_is_learnt_in_crops(tmp_path):
    result = bench(tmp_path, 'large-scene', '--points', '20000', '--crop', '6000', '--steps', '1')
    phases = ['labels, round 0', 'step 1', 'labels, round 1', 'step 2', 'prediction']
    assert list(result['phases']) == phases and all(phase['peak_mb'] > 100 for phase in result['phases'].values())
    first, second = result['labels']
    assert 0.3 < first['coverage'] <= second['coverage'] + 0.01 and second['precision'] > 0.9
    assert set(result['scores']) >= {'mIoU', 'IoU_ground', 'IoU_wall', 'IoU_roof'}


def test_clicks_on_a_scan(tmp_path):
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 2, (800, 3))
    xyz[:, 2] = np.repeat([0.0, 1.0], 400)
    np.savez(tmp_path / 'sheets.npz', xyz=xyz, semantic=np.repeat([0, 1], 400))
    result = bench(tmp_path, 'propagate-clicks', str(tmp_path / 'sheets.npz'), '--seeds', '3', '--no-walker')
    assert list(result)[:-1] == [f'{budget}, seed 3' for budget in ('one a class', 'twenty a scan', 'twenty a class')]
    many = result['twenty a class, seed 3']
    assert many['scans'] == 1 and many['walker_miou'] is None and many['intervals'] == 1
    assert many['ours_miou'] > 97 and many['seconds_prepare'] >= 0


@pytest.mark.parametrize(('words', 'said'), [
    (['prepare', '--sizes', '-5'], '--sizes: expected a whole number from 0, got -5'),
    (['octree', '--neighbors', '-1'], '--neighbors: expected a number from 0, got -1'),
])  # fmt: skip
def test_numbers_out_of_range_are_told_before_anything_runs(words, said, capsys):
    with pytest.raises(SystemExit) as caught:
        main(words)
    assert caught.value.code == 2 and said in capsys.readouterr().err
