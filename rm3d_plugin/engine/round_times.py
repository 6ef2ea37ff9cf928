"""How long labels and training of each round take: ``timing.json`` of the work directory.

It stands apart from ``metrics.json``, which holds nothing that depends on the clock.
"""

import time
from pathlib import Path
from typing import Any, NamedTuple

from rm3d_plugin.storage import content_of, read_json, write_json
from rm3d_plugin.visualization import RoundTime


class Seconds(NamedTuple):
    """Time that something took: on the wall, and of this process's processors (all threads added up)."""

    wall: float = 0.0
    cpu: float = 0.0

    def plus(self, other: 'Seconds') -> 'Seconds':
        """Both together."""
        return Seconds(self.wall + other.wall, self.cpu + other.cpu)

    def minus(self, part: 'Seconds') -> 'Seconds':
        """The rest without a part of it."""
        return Seconds(self.wall - part.wall, self.cpu - part.cpu)


class Stopwatch:
    """Runs from its making on."""

    def __init__(self) -> None:
        self._began = time.perf_counter(), time.process_time()

    def read(self) -> Seconds:
        """Time since it was made."""
        return Seconds(time.perf_counter() - self._began[0], time.process_time() - self._began[1])


class RoundTimes:
    """What is known so far; written after every change, so an interrupted run keeps what it has.

    Args:
        folder: The work directory.
        epoch: Epochs that the run has behind it; what the file says of later ones is forgotten, as they come again.
    """

    def __init__(self, folder: str | Path, epoch: int = 0) -> None:
        self.path = Path(folder) / 'timing.json'
        self._content: dict[str, Any] = {'labels': {}, 'predicting': {}, 'evaluating': {}, 'epochs': {}}
        if epoch and self.path.is_file():
            with content_of(self.path, 'the times of a run'):
                self._content |= read_json(self.path)
                self._content['epochs'] = {k: v for k, v in self._content['epochs'].items() if int(k) <= epoch}
                self.rounds()

    def labels(self, round: int, making: Seconds, predicting: Seconds, evaluating: Seconds) -> None:
        """The labels of a round were made, and evaluated.

        Args:
            round: Its number.
            making: Until the labels were there.
            predicting: What the network took of that.
            evaluating: What comparing them with the truth took after it; no part of the method.
        """
        for name, seconds in (('labels', making), ('predicting', predicting), ('evaluating', evaluating)):
            self._content[name][str(round)] = seconds._asdict()
        write_json(self.path, self._content)

    def epoch(self, number: int, round: int, seconds: Seconds) -> None:
        """An epoch (from 1) was trained on the labels of a round."""
        self._content['epochs'][str(number)] = {'round': round, **seconds._asdict()}
        write_json(self.path, self._content)

    def training(self, round: int) -> Seconds:
        """Of all epochs on the labels of a round, without validation and checkpoints."""
        epochs = (entry for entry in self._content['epochs'].values() if entry['round'] == round)
        return _total(epochs)

    def rounds(self) -> list[RoundTime]:
        """A row for each round that is known, ascending."""
        rows = []
        for name in sorted(self._content['labels'], key=int):
            labels, training = _total([self._content['labels'][name]]), self.training(int(name))
            predicting, evaluating = (_total(self._known(part, name)) for part in ('predicting', 'evaluating'))
            share = labels.cpu / training.cpu if training.cpu else None
            rows.append(RoundTime(int(name), labels.wall, predicting.wall, training.wall, share, evaluating.wall))
        return rows

    def _known(self, part: str, name: str) -> list[Any]:
        return [self._content[part][name]] if name in self._content[part] else []


def _total(entries: Any) -> Seconds:
    total = Seconds()
    for entry in entries:
        total = total.plus(Seconds(float(entry['wall']), float(entry['cpu'])))
    return total


def total_seconds(folder: str | Path) -> Seconds:
    """Training and making labels of a whole run, as its ``timing.json`` has it; nothing where there is none."""
    path = Path(folder) / 'timing.json'
    if not path.is_file():
        return Seconds()
    with content_of(path, 'the times of a run'):
        content = read_json(path)
        return _total([*content['labels'].values(), *content['epochs'].values()])
