"""What a run shows, and what it keeps for the log file."""

import logging

import pytest
import torch
from mmengine.dataset import DefaultSampler
from mmengine.model import BaseModel
from torch.utils.data import DataLoader

from rm3d_plugin.engine.screen import QuietRunner, belongs_on_screen


@pytest.mark.parametrize(
    ('text', 'shown'),
    [
        ('Epoch(train) [1][20/50]  lr: 1e-2  eta: 0:00:57', False),
        ('Epoch(train)  [1][ 50/50]  lr: 1e-2  eta: 0:00:57', True),
        ('\x1b[4mEpoch(val) [4][ 7/20]\x1b[0m', False),
        ('Epoch(test) [20/20]    mIoU: 40.0', True),
        ('Config:\nseed = 0', False),
        ('\n------------------------------\nSystem environment:', False),
        ('Exp name: run_2026', False),
        ('"FileClient" will be deprecated in future.', False),
        ('labels of round 0: coverage 99 %', True),
        ('Saving checkpoint at 2 epochs', True),
    ],
)
def test_messages(text, shown):
    record = logging.LogRecord('run', logging.INFO, __file__, 1, '%s', (text,), None)
    assert belongs_on_screen(record) == shown


class Line(BaseModel):
    def __init__(self):
        super().__init__()
        self.slope = torch.nn.Parameter(torch.ones(1))

    def forward(self, x, mode='loss'):
        return {'loss': (self.slope * x).square().mean()}


def test_a_run_shows_a_line_an_epoch_with_the_time_left_and_logs_the_rest(tmp_path, capsys):
    data = [{'x': torch.ones(1)}] * 5
    runner = QuietRunner(
        Line(),
        str(tmp_path),
        train_dataloader=DataLoader(data, sampler=DefaultSampler(data), batch_size=1),
        train_cfg={'by_epoch': True, 'max_epochs': 2},
        optim_wrapper={'optimizer': {'type': 'SGD', 'lr': 0.1}},
        default_hooks={'logger': {'type': 'LoggerHook', 'interval': 2, 'ignore_last': False}},
        default_scope='mmengine',
        experiment_name='screen',
        cfg={'a': 1},
    )
    runner.train()
    shown = [line for line in capsys.readouterr().out.splitlines() if 'INFO' in line or 'Config' in line]
    assert [line.partition('INFO - ')[2][:18] for line in shown if 'Epoch' in line] == [
        'Epoch(train) [1][5',
        'Epoch(train) [2][5',
    ]
    assert all('eta: ' in line for line in shown if 'Epoch' in line) and not any('Config' in line for line in shown)
    (log,) = tmp_path.glob('*/*.log')
    kept = log.read_text()
    assert 'Config:' in kept and 'System environment' in kept and kept.count('Epoch(train)') == 6
