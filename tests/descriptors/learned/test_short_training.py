"""A training of half a minute, by the command and the config that the weights of the package were made with."""

import numpy as np
import pytest
from runs import tiny_runs

from rm3d_plugin.datasets.scannet import ScanNetDataset
from rm3d_plugin.descriptors.learned import Contrastive
from rm3d_plugin.experiments.poses import POSES
from rm3d_plugin.experiments.scan_pairs import cut_pair, length_unit
from rm3d_plugin.experiments.scenes import read_scenes
from rm3d_plugin.experiments.tables.descriptors_matching import score_pair

LEARNT = ['demo_data.num_train=4', 'demo_data.num_val=1', 'sigma=8', 'learning_rate=3e-3', 'negative_distance=5.0']
FIGURE = 0.093  # of seed 0; seeds 1 and 2: 0.086, 0.101; learning_rate=0: 0.016 to 0.023
BAND = 0.03


def right_matches(weights, scans):
    """Share of places of an unseen room that are found again in another cut of it, turned freely."""
    part = Contrastive(weights)
    cloud = read_scenes(ScanNetDataset(scans, 'val'), [0], 8000)[0].cloud
    shares = []
    for number in range(3):
        pair = cut_pair(cloud, length_unit(cloud, 'indoor'), (0, number))
        ends = [part.compute(pair.source), part.compute(pair.targets[POSES[-1]])]
        shares.append(score_pair(pair, POSES[-1], ends, [0, number]).inliers)
    return float(np.mean(shares))


@pytest.mark.slow
def test_a_short_training_reaches_its_figure_again(tmp_path):
    options = [*LEARNT, 'threads=1', f'data_root={tmp_path}/rooms']
    arguments = ['contrastive_rooms', '--demo', '--work-dir', str(tmp_path / 'run'), '--cfg-options', *options]
    status, said = tiny_runs.run(tmp_path / 'log', tiny_runs.command, 'train', tmp_path, arguments)
    assert status == 0, said
    share = right_matches(tmp_path / 'run' / 'descriptor.npz', tmp_path / 'rooms')
    assert share == pytest.approx(FIGURE, abs=BAND)
