"""Tables as specs: what each row trains and tests, and what a user asks of a table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rm3d_plugin.baselines import FULL_SUPERVISION, LABELLED_ONLY, Task
from rm3d_plugin.experiments.render import FilledTable

DEMO = ('--demo',)
EVERY = 1_000_000  # more than there are of anything
BUDGETS = {
    '0p1pct': '0.1 % of the points',
    '0p2pct': '0.2 % of the points',
    'onept': 'a point a class',
    '20pts': '20 points',
    '1pct': '1 %',
    '20pct': '20 %',
    'scenes5pct': '5 % of the scenes',
    'scenes20pct': '20 % of the scenes',
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
        against: Name of the row over which its gain in the last score is told; None: no gain.
        paper_gain: The same gain in the paper, in points; None: not known.
        published_gain: The same in the method's own publication.
        paper: Its row in the paper's table; '': the paper has none.
    """

    name: str
    config: str
    options: Mapping[str, Any] = field(default_factory=dict)
    train: tuple[str, ...] | None = DEMO
    test: Mapping[str, Any] | None = None
    seeds: tuple[int, ...] | None = None
    against: str | None = None
    paper_gain: float | None = None
    published_gain: float | None = None
    paper: str = ''


@dataclass(frozen=True)
class Table:
    """A table of trained rows.

    Attributes:
        title: One line.
        rows: From the top.
        scores: Heading -> key of the run's final scores.
        reference: Name of the row to which the last score's ratio is told; None: no ratio.
        labels: Tell how many points have a label in the last round, and how many of the pseudo labels are right.
        cost: Tell how many seconds of the processor a run took, validation left out.
        notes: Further lines.

    Raises:
        ValueError: Two rows have one name, or the reference or what a gain is told over is no row.
    """

    title: str
    rows: tuple[Row, ...]
    scores: Mapping[str, str]
    reference: str | None = None
    labels: bool = False
    cost: bool = False
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_names(self.title, self.rows, self.reference, 'reference')
        for row in self.rows:
            _check_names(self.title, self.rows, row.against, 'against')


@dataclass(frozen=True)
class Part:
    """Rows of one task on one data set, each told beside a base row and beside the paper.

    Attributes:
        title: Heading.
        rows: From the top.
        score: Keys of a run's final scores; the mean of them counts.
        base: Name of the row that differences are told to.
        paper: The paper's table and column, ``table_ablation_fea_i:sem_scannet``; '': the paper has none.

    Raises:
        ValueError: Two rows have one name, or the base is no row.
    """

    title: str
    rows: tuple[Row, ...]
    score: tuple[str, ...]
    base: str
    paper: str = ''

    def __post_init__(self) -> None:
        _check_names(self.title, self.rows, self.base, 'base')


@dataclass(frozen=True)
class PaperTable:
    """A table of the paper, trained again.

    Attributes:
        title: One line.
        parts: In order of worth: where time is short, the first are made first.
        notes: How rows are read, where the paper leaves it open.
    """

    title: str
    parts: tuple[Part, ...]
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> tuple[Row, ...]:
        """Of all parts."""
        return tuple(row for part in self.parts for row in part.rows)


@dataclass(frozen=True)
class Scale:
    """How large tables are made.

    Attributes:
        scenes: Share of the demo's scenes, and of the scenes and points of measured tables.
        epochs: Share of the epochs of a round.
        seeds: The first so many of those that are asked for.
        parts: The first so many parts of a table of the paper.
        rows: At most so many rows of a part, evenly spread; those that differences are told to stay in any case.
    """

    scenes: float = 1.0
    epochs: float = 1.0
    seeds: int = EVERY
    parts: int = EVERY
    rows: int = EVERY

    def __str__(self) -> str:
        counts = {'seeds': self.seeds, 'parts of a table': self.parts, 'rows of a part': self.rows}
        told = [f'{number} {what}' for what, number in counts.items() if number < EVERY]
        return ', '.join([f'{self.scenes:g} of the scenes', f'{self.epochs:g} of the epochs', *told])


WHOLE = Scale()


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
        scale: Of the demos that measured tables train on.
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
    scale: Scale = WHOLE
    log: Callable[[str], None] = print


@dataclass(frozen=True)
class MeasuredTable:
    """A table that a function measures on scenes.

    Attributes:
        title: One line.
        measure: Makes it; asked anew it may take up what it left in ``out``.
        rows: What it trains on demos, for the first of the seeds; that has the request's scale.
    """

    title: str
    measure: Callable[[Request], FilledTable]
    rows: tuple[Row, ...] = ()


AnyTable = Table | PaperTable | MeasuredTable


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


def _check_names(title: str, rows: Sequence[Row], named: str | None, field: str) -> None:
    names = [row.name for row in rows]
    if len(set(names)) < len(names):
        raise ValueError(f'{title}: two rows have one name: {names}')
    if named is not None and named not in names:
        raise ValueError(f'{title}: {field}: expected one of {names}, got {named!r}')
