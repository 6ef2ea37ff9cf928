import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from engine import tiny_runs


@dataclass(frozen=True)
class FinishedRun:
    """An undisturbed training."""

    folder: Path
    log: str

    @property
    def record(self) -> dict[str, Any]:
        return json.loads((self.folder / 'metrics.json').read_text())


@pytest.fixture(scope='session')
def world(tmp_path_factory) -> Path:
    return tiny_runs.make_world(tmp_path_factory.mktemp('streets') / 'kitti')


@pytest.fixture(scope='session')
def finished(world, tmp_path_factory) -> FinishedRun:
    base = tmp_path_factory.mktemp('finished')
    code, log = tiny_runs.run(
        base / 'log.txt', tiny_runs.train, base / 'run', tiny_runs.options(world), False, None, True
    )
    assert code == 0, log
    return FinishedRun(base / 'run', log)
