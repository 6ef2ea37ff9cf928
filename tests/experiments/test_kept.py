"""A measured table goes on where it was stopped, and measures anew what was asked otherwise."""

import math
from pathlib import Path
from typing import NamedTuple

from rm3d_plugin.descriptors import FPFH
from rm3d_plugin.experiments.kept import descriptor_asked, kept_rows
from rm3d_plugin.experiments.spec import Request


class Score(NamedTuple):
    name: str
    value: float


def test_rows_are_measured_once(tmp_path):
    measured = []

    def measure():
        measured.append(1)
        return [Score('a', 1 / 3), Score('b', math.nan)]

    for seed, radius, times in ((0, 0.1, 1), (0, 0.1, 1), (1, 0.1, 2), (1, 0.2, 3)):
        asked = descriptor_asked(Request(Path('out'), seed=seed), FPFH(radius))
        rows = kept_rows(tmp_path / 'new' / 'rows.json', asked, Score, measure)
        assert rows[0] == Score('a', 1 / 3) and rows[1].name == 'b' and math.isnan(rows[1].value)
        assert len(measured) == times
