"""Several processes on one machine over gloo: the numbers of one process, each scene once, an error that ends all."""

import os
import socket
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch
from runs import tiny_runs, two_processes

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.distributed import joined_processes
from rm3d_plugin.storage import LabelStore

SCRIPT = Path(two_processes.__file__)


def torchrun(*arguments, processes=2):
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    command = [sys.executable, '-m', 'torch.distributed.run', '--nproc_per_node', str(processes)]
    command += ['--master_port', str(port), str(SCRIPT), *map(str, arguments)]
    environment = os.environ | {'OMP_NUM_THREADS': '1', 'PYTHONWARNINGS': 'ignore', 'CUDA_VISIBLE_DEVICES': ''}
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=200)


def test_two_processes_learn_what_one_learns_from_the_same_batches(tmp_path):
    result = torchrun('learn', tmp_path)
    assert result.returncode == 0, result.stderr
    wanted = two_processes.state_of_one_process()
    for rank in (0, 1):
        state = torch.load(tmp_path / f'{rank}.pt', weights_only=True)
        assert state.keys() == wanted.keys()
        for name, value in state.items():
            torch.testing.assert_close(value, wanted[name], atol=2e-5, rtol=2e-4, msg=name)


def test_an_error_in_one_process_ends_the_job_and_says_where():
    result = torchrun('break')
    assert result.returncode != 0
    assert 'process 1 of 2 ended with ValueError: scene 000007 is damaged' in result.stderr


@pytest.mark.slow
def test_each_scene_is_refreshed_by_one_process_and_labels_of_round_0_are_those_of_one_process(tmp_path):
    world = tiny_runs.make_world(tmp_path / 'world')
    result = torchrun('train', tmp_path / 'two', world)
    assert result.returncode == 0, result.stderr[-3000:]
    counts = Counter(tiny_runs.refreshes(result.stdout))
    names = ['000000', '000001', '000002']
    assert counts == {(0, s, 'geometry'): 1 for s in names} | {(1, s, 'network'): 1 for s in names}
    assert 'process 0 is done' in result.stdout and 'process 1 is done' in result.stdout
    code, log = tiny_runs.run(tmp_path / 'one.log', tiny_runs.train, tmp_path / 'one', tiny_runs.options(world))
    assert code == 0, log
    one, two = LabelStore(tmp_path / 'one' / 'labels'), LabelStore(tmp_path / 'two' / 'labels')
    for name in names:
        first, second = one.read(name, 0), two.read(name, 0)
        np.testing.assert_array_equal(first.semantic, second.semantic)
        np.testing.assert_array_equal(first.boxes.tensor, second.boxes.tensor)
    assert list(two.scenes(1)) == names


def test_more_processes_than_gpus_are_refused(monkeypatch):
    for name, value in {
        'RANK': 1,
        'LOCAL_RANK': 1,
        'WORLD_SIZE': 2,
        'MASTER_ADDR': '127.0.0.1',
        'MASTER_PORT': 1,
    }.items():
        monkeypatch.setenv(name, str(value))
    monkeypatch.setattr(torch.cuda, 'is_available', lambda: True)
    monkeypatch.setattr(torch.cuda, 'device_count', lambda: 1)
    with pytest.raises(ConfigError, match='1 were found; start 1 processes'), joined_processes('pytorch'):
        pass


def test_without_torchrun_the_launcher_is_refused(monkeypatch):
    for name in ('RANK', 'WORLD_SIZE', 'MASTER_ADDR', 'MASTER_PORT'):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ConfigError, match='torchrun --nproc_per_node N'), joined_processes('pytorch'):
        pass
    with joined_processes('none'):
        assert not torch.distributed.is_initialized()
