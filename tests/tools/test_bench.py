"""The benchmark command: runs, counts operations as by hand, writes what it prints."""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_sparse_unet(tmp_path):
    out = tmp_path / 'sub' / 'unet.json'
    command = [sys.executable, str(ROOT / 'tools' / 'bench.py'), 'sparse-unet', '--voxels', '300', '--channels', '4']
    command += ['--blocks', '1', '--backward', '--repeats', '2', '--json', str(out)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tmp_path).stdout
    result = json.loads(out.read_text())
    assert json.loads(printed) == result
    assert abs(result['voxels'] - 300) <= 15
    pairs = round(result['active_neighbours'] * result['voxels'])
    convolutions = 3  # the stem and two of the block, 4 -> 4 channels each
    assert abs(result['flops'] / (2 * 16 * convolutions) - pairs) <= 0.005 * result['voxels'] + 1
    assert result['forward_backward_flops'] == 3 * result['flops']
    assert all(result[key] > 0 for key in ('forward_s', 'forward_backward_s', 'gemm_gflops', 'forward_share_of_gemm'))
    assert result['machine']['torch_threads'] == 1
