"""Pseudo labels and offsets by round of compared methods and RM3D, after the paper's Figure 8.

Not all of them store pseudo labels, so the same is read from all: what the network says of the training points at the
end of each round, where it is sure, and the centres that the points vote for.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rm3d_plugin.baselines import BASELINES
from rm3d_plugin.engine.hooks.prediction_quality_hook import RECORD
from rm3d_plugin.experiments.render import FilledTable
from rm3d_plugin.experiments.runner import Commands, run_folder, run_rows
from rm3d_plugin.experiments.scale import scaled_row
from rm3d_plugin.experiments.spec import Request, Row
from rm3d_plugin.experiments.tables.figures import Quality, fill_quality, quality_of
from rm3d_plugin.storage import content_of, read_json

COMPARED = ('otoc', 'gpc', 'psd')  # of the paper's figure
LEAF = '{}_ins_scannet_0p2pct'
THRESHOLD = 0.9
OBSERVED = {'method_hook': {'type': 'PredictionQualityHook', 'threshold': THRESHOLD}}
OFFSETS: Mapping[str, Any] = {'offset_weight': 1.0}  # else those learn none from so few points
TITLE = (
    'What networks say of the training points, by round and method: instances of demo rooms, 0.2 % annotated, seed {}'
)
NOTES = (
    f'Answers from a probability of {THRESHOLD:g} on count as pseudo labels, point by point, for all methods alike.',
    'Offsets of the compared methods are learnt from the annotated points of an object, here as an exception.',
)


def observed_rows() -> tuple[Row, ...]:
    """What is trained: the compared methods, RM3D as in the paper, and RM3D."""
    compared = [Row(BASELINES[name].row('ins'), LEAF.format(name), {**OFFSETS, **OBSERVED}) for name in COMPARED]
    ours = LEAF.format('rm3d')
    return (
        *compared,
        Row('RM3D as in the paper', ours, {'strategy': 'paper', **OBSERVED}),
        Row('RM3D', ours, OBSERVED),
    )


def method_pseudo_label_table(request: Request, commands: Commands | None = None) -> FilledTable:
    """Train the methods with a hook that notes what their networks say, and read its records.

    Args:
        request: Its seed draws the labels.
        commands: What trains.

    Raises:
        ConfigError: A run failed.
    """
    rows = [scaled_row(row, request.scale) for row in observed_rows()]
    run_rows(rows, replace(request, seeds=(request.seed,)), commands)
    found = [said for row in rows for said in noted(row.name, run_folder(request.out, row, request.seed))]
    return fill_quality(found, TITLE.format(request.seed), NOTES)


def noted(method: str, folder: Path) -> list[Quality]:
    """What the hook noted in a finished run, by round."""
    path = folder / RECORD
    with content_of(path, 'what a network said by round'):
        return [quality_of(method, int(number), told) for number, told in read_json(path).items()]
