"""Our rows beside the paper's: differences taken anew, and whether their signs agree beyond the noise of the seeds."""

import math
import statistics
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats import ttest_rel

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.experiments.paper import paper_value
from rm3d_plugin.experiments.render import Cell, FilledTable, NamedRow, Section, bar_figure
from rm3d_plugin.experiments.runner import final_scores, run_folder, seeds_of
from rm3d_plugin.experiments.spec import PaperTable, Part, Request, Row

Sign = Literal['agrees', 'differs', 'within noise', 'one seed', '-']
LEVEL = 0.05  # of the test
TEST = f'Sign: of the difference, beside the paper; paired t-test over the seeds, two-sided, p < {LEVEL:g}.'
HEADS = ('ours (lowest to highest)', 'delta', 'p', 'paper', 'delta', 'sign')
NONE: Literal['-'] = '-'


class Comparison(NamedTuple):
    """One row, ours and the paper's.

    Attributes:
        values: Ours, one a seed; percent.
        deltas: Differences to the base row, seed by seed; () for the base itself and for other seeds.
        p: Of the paired test; None where there is none.
        paper: The paper's value.
        paper_delta: Its difference to the paper's base.
        sign: Whether both differences have one sign.
    """

    values: tuple[float, ...]
    deltas: tuple[float, ...]
    p: float | None
    paper: float | None
    paper_delta: float | None
    sign: Sign


def paired_p(deltas: Sequence[float]) -> float | None:
    """Chance (p) of the two-sided paired t-test that the mean difference is zero; None with fewer than two.

    >>> round(paired_p([1.0, 2.0, 3.0]), 4)
    0.0742
    """
    if len(deltas) < 2:
        return None
    if len(set(deltas)) == 1:  # no spread: scipy has no answer
        return 0.0 if deltas[0] else 1.0
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # nearly no spread
        return float(ttest_rel(deltas, np.zeros(len(deltas))).pvalue)


def sign_of(deltas: Sequence[float], p: float | None, paper_delta: float | None) -> Sign:
    """Whether our difference and the paper's have one sign.

    Args:
        deltas: Ours, one a seed.
        p: Of the paired test.
        paper_delta: The paper's; None or 0: nothing to compare with.
    """
    if not deltas or not paper_delta:
        return NONE
    if p is None:
        return 'one seed'
    if p >= LEVEL:
        return 'within noise'
    return 'agrees' if statistics.mean(deltas) * paper_delta > 0 else 'differs'


def compare(part: Part, scores: Mapping[str, Mapping[int, float]]) -> dict[str, Comparison]:
    """Every row of a part beside its base and the paper.

    Args:
        part: Rows, base and place in the paper.
        scores: Row's name -> seed -> value.
    """
    base = scores[part.base]
    papers = {row.name: paper_value(part.paper, row.paper) for row in part.rows}
    found = {}
    for row in part.rows:
        own, paper = scores[row.name], papers[row.name]
        deltas = () if row.name == part.base else tuple(own[seed] - base[seed] for seed in own if seed in base)
        known = paper is not None and papers[part.base] is not None and row.name != part.base
        paper_delta = paper - papers[part.base] if known else None  # type: ignore[operator]
        p = paired_p(deltas)
        found[row.name] = Comparison(
            tuple(own.values()), deltas, p, paper, paper_delta, sign_of(deltas, p, paper_delta)
        )
    return found


def fill_paper_table(table: PaperTable, request: Request) -> FilledTable:
    """Read the records of all runs of a table; they must be finished.

    Args:
        table: Its parts.
        request: Folder and seeds.
    """
    scores = {part.title: _scores(part, request) for part in table.parts}
    return filled(table, {part.title: compare(part, scores[part.title]) for part in table.parts}, scores)


def filled(
    table: PaperTable,
    found: Mapping[str, Mapping[str, Comparison]],
    scores: Mapping[str, Mapping[str, Mapping[int, float]]],
) -> FilledTable:
    """The table of comparisons.

    Args:
        table: Its parts.
        found: Part -> row -> comparison.
        scores: Part -> row -> seed -> value.
    """
    sections = tuple(_section(part, found[part.title]) for part in table.parts)
    seeds = sorted({seed for rows in scores.values() for own in rows.values() for seed in own})
    records = tuple(
        {'part': part, 'row': row, 'seed': seed, 'value': value}
        for part, rows in scores.items()
        for row, own in rows.items()
        for seed, value in own.items()
    )
    return FilledTable(
        title=f'{table.title}; mean of seeds {", ".join(map(str, seeds))}',
        notes=(*table.notes, TEST),
        sections=sections,
        records=records,
        figure=_figure(sections),
    )


def _figure(sections: Sequence[Section]) -> Callable[[], bytes]:
    return lambda: bar_figure(sections, 1, 'percent')


def _scores(part: Part, request: Request) -> dict[str, dict[int, float]]:
    return {row.name: {seed: _score(part, row, seed, request) for seed in seeds_of(row, request)} for row in part.rows}


def _score(part: Part, row: Row, seed: int, request: Request) -> float:
    """Mean of the scores that are known: a class may be in no scene that is tested."""
    scores = final_scores(request.out, row, seed)
    known = [value for key in part.score if (value := scores.get(key)) is not None and not math.isnan(value)]
    if not known:
        folder = run_folder(request.out, row, seed)
        raise ConfigError(f'{folder}: expected a score {" or ".join(part.score)}, got {", ".join(scores)}')
    return statistics.mean(known)


def _section(part: Part, found: Mapping[str, Comparison]) -> Section:
    rows = tuple(NamedRow(_name(row), _cells(found[row.name])) for row in part.rows)
    return Section(f'{part.title}; differences to: {part.base}', ('row', *HEADS), rows)


def _name(row: Row) -> str:
    return f'{row.paper}. {row.name}' if row.paper.isdigit() else row.name


def _cells(found: Comparison) -> tuple[Cell, ...]:
    spread = f'{min(found.values):.1f} to {max(found.values):.1f}'
    ours = Cell(f'{statistics.mean(found.values):.1f} ({spread})', found.values)
    delta = Cell(f'{statistics.mean(found.deltas):+.1f}', found.deltas) if found.deltas else Cell(NONE)
    return (
        ours,
        delta,
        Cell(NONE if found.p is None else f'{found.p:.2g}'),
        Cell(NONE if found.paper is None else f'{found.paper:.1f}'),
        Cell(NONE if found.paper_delta is None else f'{found.paper_delta:+.1f}'),
        Cell(found.sign),
    )
