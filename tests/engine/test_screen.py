"""What a run shows, and what it keeps for the log file."""

import logging
import shutil
import time
from typing import ClassVar

import pytest
import torch
from mmengine.dataset import DefaultSampler
from mmengine.model import BaseModel
from mmengine.registry import VISBACKENDS
from mmengine.visualization.vis_backend import BaseVisBackend
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch.utils.data import DataLoader

from rm3d_plugin.engine.screen import QuietRunner, belongs_on_screen
from rm3d_plugin.registry import SCOPE


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


@VISBACKENDS.register_module()
class KeptNumbers(BaseVisBackend):
    """A backend of one's own."""

    seen: ClassVar[list[tuple[str, int]]] = []

    def _init_env(self):
        pass

    @property
    def experiment(self):
        return self.seen

    def add_scalar(self, name, value, step=0, **kwargs):
        self.seen.append((name, step))

    def add_scalars(self, scalar_dict, step=0, file_path=None, **kwargs):
        self.seen.extend((name, step) for name in scalar_dict)


def run_line(folder, **options):
    data = [{'x': torch.ones(1)}] * 5
    runner = QuietRunner(
        Line(),
        str(folder),
        train_dataloader=DataLoader(data, sampler=DefaultSampler(data), batch_size=1),
        train_cfg={'by_epoch': True, 'max_epochs': 2},
        optim_wrapper={'optimizer': {'type': 'SGD', 'lr': 0.1}},
        default_hooks={'logger': {'type': 'LoggerHook', 'interval': 2, 'ignore_last': False}},
        default_scope=SCOPE,
        experiment_name=folder.name,
        cfg={'a': 1},
        **options,
    )
    runner.train()


def test_tensorboard_and_a_backend_of_ones_own_see_every_loss(tmp_path):
    backends = [dict(type='TensorboardVisBackend'), dict(type='KeptNumbers')]
    run_line(tmp_path, visualizer=dict(type='Visualizer', vis_backends=backends))
    (events,) = tmp_path.glob('*/vis_data/events.out.tfevents.*')
    read = EventAccumulator(str(events))
    read.Reload()
    assert [event.step for event in read.Scalars('loss')] == [2, 4, 5, 7, 9, 10]
    assert {step for name, step in KeptNumbers.seen if name == 'loss'} == {2, 4, 5, 7, 9, 10}


def test_runs_of_one_second_and_one_name_keep_apart(tmp_path, monkeypatch):
    monkeypatch.setattr(QuietRunner, '_latest', time.time() + 1000)  # as if each began before its second was over
    folders = [tmp_path / number / 'corner' for number in ('1', '2', '3')]
    for folder in folders:
        run_line(folder)
        shutil.rmtree(folder.parent) if folder == folders[1] else None  # what follows writes nothing there
    moments = [time.mktime(time.strptime(path.name, '%Y%m%d_%H%M%S')) for path in map(made_in, folders[::2])]
    assert moments[1] == moments[0] + 2 and not folders[1].exists()
    assert all(len(list(made_in(folder).glob('*.log'))) == 1 for folder in folders[::2])


def made_in(folder):
    (found,) = (path for path in folder.iterdir() if path.is_dir() and (path / 'vis_data').is_dir())
    return found


def test_a_run_shows_a_line_an_epoch_with_the_time_left_and_logs_the_rest(tmp_path, capsys):
    run_line(tmp_path)
    shown = [line for line in capsys.readouterr().out.splitlines() if 'INFO' in line or 'Config' in line]
    assert [line.partition('INFO - ')[2][:18] for line in shown if 'Epoch' in line] == [
        'Epoch(train) [1][5',
        'Epoch(train) [2][5',
    ]
    assert all('eta: ' in line for line in shown if 'Epoch' in line) and not any('Config' in line for line in shown)
    (log,) = tmp_path.glob('*/*.log')
    kept = log.read_text()
    assert 'Config:' in kept and 'System environment' in kept and kept.count('Epoch(train)') == 6
