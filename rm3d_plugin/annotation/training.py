"""Training beside a session: `rm3d label --train` in a process of its own, and what its labels would change."""

import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from rm3d_plugin.annotation.session import Session
from rm3d_plugin.inference.label_files import SAME, SUMMARY, target_name
from rm3d_plugin.storage import read_json
from rm3d_plugin.storage.columns import read_columns
from rm3d_plugin.structures import UNLABELLED, SceneError

LOG = 'train.log'
SHOWN = 160  # characters of the last line of the log


class Difference(NamedTuple):
    """What a training says otherwise than the labels of now.

    Attributes:
        semantic: Class of each point that it would change, -1 elsewhere; labelled points stay.
        heard: The network has a say; False: clicks that it was not taught do not speak for it, and these are labels
            without it.
    """

    semantic: Int[np.ndarray, ' points']
    heard: bool

    def counts(self, num_classes: int) -> Int[np.ndarray, ' classes']:
        """Points that would change to each class."""
        return np.bincount(self.semantic[self.semantic >= 0], minlength=num_classes)


@dataclass(frozen=True)
class TrainingPlan:
    """How a training is run.

    Attributes:
        folder: Receives labels, ``training/run`` (an ordinary work directory) and :data:`LOG`; is new.
        minutes: For the network, after the labels without it.
        options: ``KEY=VALUE`` of the config.
    """

    folder: Path
    minutes: float
    options: Sequence[str] = ()


class Training:
    """A process that trains on the labels that a session has now; the session goes on.

    Args:
        session: Whose labels.
        plan: How.

    Raises:
        SceneError: Labels of two classes are needed.
    """

    def __init__(self, session: Session, plan: TrainingPlan) -> None:
        self.plan, self._session, self._began = plan, session, time.monotonic()
        self._scans = session.labelled_scans()
        found = {int(each) for scan in self._scans for each in np.unique(session.scan(scan).annotated) if each >= 0}
        if len(found) < 2:
            raise SceneError(f'training needs labels of two classes, got {len(found)}: label a point of each class')
        self._numbers = {name: number for number, name in enumerate(session.classes)}
        plan.folder.mkdir(parents=True, exist_ok=True)
        with (plan.folder / LOG).open('wb') as log:
            self._process = subprocess.Popen(self._command(), stdout=log, stderr=subprocess.STDOUT)

    def _command(self) -> list[str]:
        clicks = self._session.export_clicks(self.plan.folder / 'clicks.csv')
        words = ['label', *(str(self._session.path(scan)) for scan in self._scans), '--clicks', str(clicks)]
        words += ['--out', str(self.plan.folder), '--train', f'{self.plan.minutes:g}']
        if self._session.columns is not None:
            words += ['--columns', self._session.columns]
        words += ['--cfg-options', *self.plan.options] if self.plan.options else []
        return [sys.executable, '-m', 'rm3d_plugin', *words]

    @property
    def running(self) -> bool:
        """Whether the process lives."""
        return self._process.poll() is None

    @property
    def progress(self) -> float:
        """Share of the time that is over, in [0, 1]."""
        return min((time.monotonic() - self._began) / (60 * self.plan.minutes), 1.0) if self.running else 1.0

    def told(self) -> str:
        """What it says: the last line of its log, or how it ended."""
        text = (self.plan.folder / LOG).read_text(encoding='utf-8', errors='replace')
        lines = [line.strip() for line in text.replace('\r', '\n').splitlines() if line.strip()]
        last = lines[-1][:SHOWN] if lines else ''
        code = self._process.poll()
        return last if code is None else 'training is done' if code == 0 else f'training ended with {code}: {last}'

    def stop(self) -> None:
        """End the process; what it has written stays."""
        if self.running:
            self._process.terminate()
            self._process.wait()

    def labelled(self, scan: str) -> bool:
        """Whether it is done and has labels of a scan."""
        return not self.running and self._process.returncode == 0 and scan in self._scans

    def difference(self, scan: str) -> Difference:
        """What the labels of the training would change in a scan.

        Raises:
            SceneError: It is not done, failed, or had no label of this scan.
        """
        if self.running or self._process.returncode != 0:
            raise SceneError(f'no labels of a training: {self.told()}')
        path = self._session.path(scan)
        summary = read_json(self.plan.folder / SUMMARY)
        if scan not in summary['scans']:
            raise SceneError(f'scan {scan}: had no label when the training began')
        table = np.array([self._numbers[each['name']] for each in summary['classes']])
        said = table[read_columns(self.plan.folder / target_name(path, SAME))['label']]
        now, annotated = self._session.labels(scan).semantic, self._session.scan(scan).annotated
        changed = (said != now) & (annotated < 0)
        return Difference(np.where(changed, said, UNLABELLED), 'network' in summary['scans'][scan]['method'])


def accept(session: Session, scan: str, difference: Difference, chosen: Bool[np.ndarray, ' points']) -> int:
    """Label the points that a training would change and that are chosen, one action; returns how many.

    Args:
        session: That is labelled.
        scan: Name of the scan.
        difference: Of this scan.
        chosen: Points whose change is accepted.

    Raises:
        SceneError: None of them would change.
    """
    points = np.flatnonzero(chosen & (difference.semantic >= 0))
    session.give(scan, points, difference.semantic[points])
    return len(points)
