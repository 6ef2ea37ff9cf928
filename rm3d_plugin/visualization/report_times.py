"""Where the time of a run went."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import NamedTuple

from rm3d_plugin.visualization.report_sections import DASH, duration, percent, section, table


class RoundTime(NamedTuple):
    """What one round took.

    Attributes:
        round: Its number.
        labels: Wall-clock seconds until its labels were there (in the first round: preparing the geometry, too).
        predicting: Those of them that the network took to predict the training scenes.
        training: Wall-clock seconds of the epochs on these labels, without validation.
        share: Labels / training in seconds of the processor, which other programs do not change; None: no training.
        evaluating: Wall-clock seconds, on top of ``labels``, of comparing them with the truth, where it is known.
    """

    round: int
    labels: float
    predicting: float
    training: float
    share: float | None
    evaluating: float = 0.0


def time_section(seconds: Mapping[str, float], rounds: Sequence[RoundTime] = ()) -> str:
    """The whole run by stage, and the labels of each round beside its training."""
    parts = [part for part in (_stages(seconds), _rounds(rounds)) if part]
    return section('time', 'Time', '\n'.join(parts)) if parts else ''


def _stages(seconds: Mapping[str, float]) -> str:
    if not seconds:
        return ''
    total = sum(seconds.values())
    body = [[escape(k), duration(v), percent(v / total if total else None, 0)] for k, v in seconds.items()]
    body.append(['all', duration(total), percent(1.0 if total else None, 0)])
    return table(['Stage', 'Time', 'Share'], body, 'Wall-clock time', 1, [len(body) - 1])


def _rounds(rounds: Sequence[RoundTime]) -> str:
    if not rounds:
        return ''
    body = [
        [
            str(row.round),
            duration(row.labels),
            duration(row.predicting) if row.round else DASH,
            duration(row.training) if row.training else DASH,
            percent(row.share),
            duration(row.evaluating) if row.evaluating else DASH,
        ]
        for row in rounds
    ]
    head = ['Round', 'Labels', 'of it predicting', 'Training', 'Labels / training', 'Evaluating']
    caption = 'Labels of each round beside the training on them (wall clock; the share in seconds of the processor)'
    return table(head, body, caption, 1)
