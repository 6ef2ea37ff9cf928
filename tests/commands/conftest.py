import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from runs import tiny_runs

Command = Callable[..., tuple[int, str]]


@pytest.fixture
def call(tmp_path) -> Command:
    """Call a command of tools/ in an empty folder: ``call('train', CONFIG, '--demo')`` -> exit code, output."""
    (tmp_path / 'cwd').mkdir()

    def called(tool: str, *arguments: object) -> tuple[int, str]:
        return tiny_runs.run(
            tmp_path / 'log.txt', tiny_runs.command, tool, tmp_path / 'cwd', [str(word) for word in arguments]
        )

    return called


@pytest.fixture(scope='session')
def trained(world, tmp_path_factory) -> Path:
    """Work folder of a run that learnt its scenes by heart, so that its scores are not all zero.

    It sees all boxes, and is validated on the training scenes.
    """
    folder = tmp_path_factory.mktemp('trained')
    shutil.copytree(world, folder / 'kitti')
    lists = folder / 'kitti' / 'ImageSets'
    shutil.copy(lists / 'train.txt', lists / 'val.txt')
    settings = tiny_runs.options(folder / 'kitti', **tiny_runs.LEARNT)
    code, log = tiny_runs.run(
        folder / 'log.txt', tiny_runs.command, 'train', folder, tiny_runs.arguments_of(settings, folder / 'run')
    )
    assert code == 0, log
    return folder / 'run'
