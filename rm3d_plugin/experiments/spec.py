"""Tables as specs: what each row trains and tests, and what a user asks of a table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rm3d_plugin.baselines import FULL_SUPERVISION, LABELLED_ONLY, Task
from rm3d_plugin.experiments.render import FilledTable

DEMO = ('--demo',)
BUDGETS = {
    '0p1pct': '0.1 % of the points',
    '0p2pct': '0.2 % of the points',
    'onept': 'a point a class',
    '20pts': '20 points',
    '1pct': '1 %',
    '20pct': '20 %',
}


@dataclass(frozen=True)
class Row:
    """One row of a table: one training a seed, and how its network is scored.

    Rows that train the same share the runs.

    Attributes:
        name: As the table prints it.
        config: Name of a leaf in ``configs/``, or a config file.
        options: Config keys that differ from the config; they stand in the name of the run's folder.
        train: Arguments of the train command, such as ``--demo``. None: nothing is trained here, the runs of another
            table are scored; they must be finished.
        test: Config keys under which the trained network is tested anew (other data, turned scenes). None: the last
            validation of the training counts.
        seeds: Of this row; None: those that the user asks for.
    """

    name: str
    config: str
    options: Mapping[str, Any] = field(default_factory=dict)
    train: tuple[str, ...] | None = DEMO
    test: Mapping[str, Any] | None = None
    seeds: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Table:
    """A table of trained rows.

    Attributes:
        title: One line.
        rows: From the top.
        scores: Heading -> key of the run's final scores.
        reference: Name of the row to which the last score's ratio is told; None: no ratio.
        labels: Tell how many points have a label in the last round, and how many of the pseudo labels are right.

    Raises:
        ValueError: Two rows have one name, or the reference is no row.
    """

    title: str
    rows: tuple[Row, ...]
    scores: Mapping[str, str]
    reference: str | None = None
    labels: bool = False

    def __post_init__(self) -> None:
        names = [row.name for row in self.rows]
        if len(set(names)) < len(names):
            raise ValueError(f'{self.title}: two rows have one name: {names}')
        if self.reference is not None and self.reference not in names:
            raise ValueError(f'{self.title}: reference: expected one of {names}, got {self.reference!r}')


@dataclass(frozen=True)
class Request:
    """What a user asks of a table.

    Attributes:
        out: Folder of runs and results; what is finished there is kept.
        seeds: Of trained tables: one run a row and seed; the seed draws the label budget, too.
        jobs: Runs at the same time, one thread each; with 1 a run takes every core.
        options: ``KEY=VALUE``, config keys of every run; they win over those of a row.
        data: Of measured tables: kinds of scenes; those that are not there are left out.
        descriptors: Of tables of descriptors: type names; none: all that are compared.
        scenes: Of each kind, at most.
        points: Of each scene, the so many nearest to its middle; None: all.
        seed: Of all that a measured table draws.
        data_root: Folder where synthetic scenes are made or real scans are found; None: the table's own default.
        log: Told what starts and ends.
    """

    out: Path
    seeds: Sequence[int] = (0, 1, 2)
    jobs: int = 1
    options: Sequence[str] = ()
    data: Sequence[str] = ()
    descriptors: Sequence[str] = ()
    scenes: int = 2
    points: int | None = None
    seed: int = 0
    data_root: Path | None = None
    log: Callable[[str], None] = print


@dataclass(frozen=True)
class MeasuredTable:
    """A table that a function measures on scenes.

    Attributes:
        title: One line.
        measure: Makes it; asked anew it may take up what it left in ``out``.
    """

    title: str
    measure: Callable[[Request], FilledTable]


def method_rows(
    task: Task,
    data: str,
    budgets: Sequence[str],
    full: bool = True,
    train: tuple[str, ...] = DEMO,
) -> tuple[Row, ...]:
    """For each budget the labels alone, RM3D as in the paper and RM3D; then full supervision.

    Args:
        task: sem, ins or votenet.
        data: Data set, as configs name it.
        budgets: Label budgets, as configs name them.
        full: False leaves full supervision out.
        train: Arguments of the train command.
    """
    rows = []
    for budget in budgets:
        leaf, shown = f'rm3d_{task}_{data}_{budget}', f'({BUDGETS[budget]})'
        alone = LABELLED_ONLY.config(task, data, budget)
        rows += [
            Row(f'{LABELLED_ONLY.row(task)} {shown}', alone, train=train),
            Row(f'RM3D as in the paper {shown}', leaf, {'strategy': 'paper'}, train),
            Row(f'RM3D {shown}', leaf, train=train),
        ]
    if full:
        rows.append(Row(full_row(task), FULL_SUPERVISION.config(task, data, ''), train=train))
    return tuple(rows)


def full_row(task: Task) -> str:
    """Name of the row of full supervision, to which ratios are told."""
    return FULL_SUPERVISION.row(task)
