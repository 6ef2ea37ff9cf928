"""The runner with the commands that users type: a tiny training, and a test of its network."""

from dataclasses import replace

import pytest
from runs import tiny_runs

from rm3d_plugin.experiments.runner import final_scores, run_folder, run_rows
from rm3d_plugin.experiments.spec import Request, Row
from rm3d_plugin.storage import read_json


@pytest.mark.slow
def test_a_network_tested_on_the_same_scenes_scores_as_its_last_validation(world, tmp_path):
    told = []
    row = Row('trained', 'rm3d_votenet_kitti_1pct', tiny_runs.options(world), train=())
    rows = [row, replace(row, name='tested', test={'num_workers': 0})]
    request = Request(tmp_path / 'out', seeds=(4,), log=told.append)
    run_rows(rows, request)
    trained, tested = (final_scores(request.out, row, 4) for row in rows)
    assert 'mAP_3d_moderate_R40_loose' in trained and tested == pytest.approx(trained)
    assert read_json(run_folder(request.out, row, 4) / 'metrics.json')['seed'] == 4
    assert [line.split(': ')[1].split(';')[0] for line in told] == ['training', 'done', 'testing', 'done']
