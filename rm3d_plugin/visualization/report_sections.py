"""The parts of the report page, each from plain values to HTML."""

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from rm3d_plugin.visualization.curves import Chart, draw_chart
from rm3d_plugin.visualization.report_style import STYLE

DASH = '&ndash;'
SYNTHETIC_NOTE = (
    'The data of this run are synthetic: generated scenes in the real file format. The numbers say that the method '
    'works, not how well it does on real scans.'
)


def page(title: str, synthetic: bool, notes: Sequence[str], sections: Sequence[str]) -> str:
    """The whole document."""
    warnings = [SYNTHETIC_NOTE] if synthetic else []
    told = ''.join(f'<p class="warning" role="note">{escape(text)}</p>' for text in warnings)
    told += ''.join(f'<p class="note">{escape(text)}</p>' for text in notes)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f'<title>{escape(title)}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n'
        f'<h1>{escape(title)}</h1>\n{told}\n' + '\n'.join(sections) + '\n</main>\n</body>\n</html>\n'
    )


def summary_section(facts: Mapping[str, Any]) -> str:
    """Headline numbers as tiles."""
    if not facts:
        return ''
    tiles = ''.join(f'<div><dt>{escape(k)}</dt><dd>{escape(plain(v))}</dd></div>' for k, v in facts.items())
    return f'<section aria-label="Summary"><dl class="tiles">{tiles}</dl></section>'


def result_section(rows: Sequence[tuple[str, str, float, float, float]]) -> str:
    """Average precision by class and difficulty."""
    if not rows:
        return ''
    body = [[escape(row[0]), escape(row[1]), *(number(value) for value in row[2:])] for row in rows]
    means = [i for i, row in enumerate(rows) if row[0] == 'mean']
    content = table(['Class', 'Metric', 'Easy', 'Moderate', 'Hard'], body, 'Average precision in percent', 2, means)
    return section('results', 'Results', content)


def score_section(caption: str, head: Sequence[str], rows: Sequence[tuple[Any, ...]]) -> str:
    """Scores of classes."""
    body = [[escape(str(row[0])), *(number(value) for value in row[1:])] for row in rows]
    means = [i for i, row in enumerate(rows) if row[0] == 'mean']
    return section('results', 'Results', table(head, body, caption, 1, means))


@dataclass(frozen=True)
class BudgetSummary:
    """Which labels training saw.

    Attributes:
        name: As users write it ('two boxes per ten scenes').
        digest: Hash of the drawn budget.
        counts: Annotated and existing labels by class name.
        seed: Of the draw, None where the budget was imported.
        unit: What was annotated, in words: boxes, points, clicked points.
        total_known: Whether anybody knows how many labels there are; not where a person clicked.
    """

    name: str
    digest: str
    counts: Mapping[str, tuple[int, int]]
    seed: int | None = None
    unit: str = 'labels'
    total_known: bool = True


def budget_words(shown: int, total: int, unit: str, total_known: bool) -> str:
    """How many labels training saw.

    >>> budget_words(20, 782, 'boxes', True), budget_words(30, 30, 'clicked points', False)
    ('20 of 782 boxes, 2.6 %', '30 clicked points')
    """
    if not total_known:
        return f'{shown:,} {unit}'
    return f'{shown:,} of {total:,} {unit}, {100 * shown / max(total, 1):.2g} %'


def budget_section(budget: BudgetSummary) -> str:
    """Which labels training saw."""
    rows = dict(budget.counts)
    all_shown, all_there = (sum(pair[i] for pair in rows.values()) for i in (0, 1))
    if len(rows) > 1:
        rows['all'] = (all_shown, all_there)
    seeded = '' if budget.seed is None or not budget.total_known else f', seed {budget.seed}'
    told = budget_words(all_shown, all_there, budget.unit, budget.total_known)
    drawn = f'{escape(budget.name)}{seeded}; hash <code>{escape(budget.digest)}</code>'
    words = f'<p><strong>{escape(told)}</strong> ({drawn})</p>'
    head = ['Class', 'Annotated', *(['Existing', 'Share'] if budget.total_known else [])]
    body = [
        [
            escape(name),
            str(shown),
            *([str(total), percent(shown / total if total else None, 2)] if budget.total_known else []),
        ]
        for name, (shown, total) in rows.items()
    ]
    content = table(head, body, 'Labels that training saw', 1, [len(body) - 1] if len(budget.counts) > 1 else [])
    return section('budget', 'Label budget', words + content)


def chart_section(charts: Sequence[Chart]) -> str:
    """Curves side by side, the small ones first."""
    if not charts:
        return ''
    small, large = [chart for chart in charts if chart.small], [chart for chart in charts if not chart.small]
    groups = (('charts small', small), ('charts', large))
    content = ''.join(
        f'<div class="{kind}">{"".join(draw_chart(chart) for chart in group)}</div>' for kind, group in groups if group
    )
    return section('curves', 'Curves', content)


def picture_section(pictures: Sequence[tuple[str, bytes]]) -> str:
    """Pictures below each other, inline."""
    if not pictures:
        return ''
    figures = ''.join(
        f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{base64.b64encode(png).decode("ascii")}">'
        f'<figcaption>{escape(caption)}</figcaption></figure>'
        for caption, png in pictures
    )
    return section('scenes', 'Scenes from above', figures)


def config_section(settings: Mapping[str, Any], text: str) -> str:
    """The settings that matter, the whole config behind a fold."""
    if not settings and not text:
        return ''
    body = [[escape(k), f'<code>{escape(plain(v))}</code>'] for k, v in settings.items()]
    content = table(['Setting', 'Value'], body, 'Settings', 2) if body else ''
    fold = f'<details><summary>The whole config</summary><pre>{escape(text)}</pre></details>' if text else ''
    return section('config', 'Configuration', content + fold)


def duration(seconds: float) -> str:
    """Seconds for people.

    >>> duration(4.26), duration(75), duration(3725)
    ('4.3 s', '1 min 15 s', '1 h 2 min')
    """
    if seconds < 60:
        return f'{seconds:.1f} s'
    whole = round(seconds)
    if whole < 3600:
        return f'{whole // 60} min {whole % 60} s'
    return f'{whole // 3600} h {whole % 3600 // 60} min'


def section(anchor: str, heading: str, content: str) -> str:
    """A part of the page under a heading."""
    return f'<section aria-labelledby="{anchor}"><h2 id="{anchor}">{escape(heading)}</h2>\n{content}\n</section>'


def table(
    head: Sequence[str], body: Sequence[Sequence[str]], caption: str, words: int, strong: Sequence[int] = ()
) -> str:
    """A table of finished cells; the first ``words`` columns are text, the rows ``strong`` stand out."""
    cells = ''.join(f'<th scope="col"{"" if i < words else _RIGHT}>{escape(name)}</th>' for i, name in enumerate(head))
    return _frame(f'<tr>{cells}</tr>', body, caption, words, strong)


def grouped_table(
    head: Sequence[tuple[str, Sequence[str]]], body: Sequence[Sequence[str]], caption: str, strong: Sequence[int] = ()
) -> str:
    """A table whose columns come in named groups; a group without columns is a column."""
    top = ''.join(
        f'<th scope="colgroup" colspan="{len(columns)}">{escape(name)}</th>'
        if columns
        else f'<th scope="col" rowspan="2">{escape(name)}</th>'
        for name, columns in head
    )
    below = ''.join(f'<th scope="col"{_RIGHT}>{escape(c)}</th>' for _, columns in head for c in columns)
    return _frame(f'<tr>{top}</tr><tr>{below}</tr>', body, caption, 1, strong)


def _frame(head: str, body: Sequence[Sequence[str]], caption: str, words: int, strong: Sequence[int] = ()) -> str:
    rows = []
    for place, row in enumerate(body):
        first = f'<th scope="row">{row[0]}</th>'
        rest = ''.join(f'<td{"" if i < words else _RIGHT}>{cell}</td>' for i, cell in enumerate(row[1:], start=1))
        rows.append(f'<tr{_STRONG if place in strong else ""}>{first}{rest}</tr>')
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}">'
        f'<table><caption>{escape(caption)}</caption>'
        f'<thead>{head}</thead><tbody>{"".join(rows)}</tbody></table></div>'
    )


_RIGHT = ' class="number"'
_STRONG = ' class="strong"'


def plain(value: Any) -> str:
    """Any value, numbers to four digits."""
    return f'{value:.4g}' if isinstance(value, float) else str(value)


def number(value: float | None, digits: int = 2) -> str:
    """So many digits after the point; a dash for nothing."""
    return DASH if value is None or not math.isfinite(value) else f'{value:.{digits}f}'


def percent(share: float | None, digits: int = 1) -> str:
    """A share in [0, 1] as percent; a dash for nothing."""
    return DASH if share is None or not math.isfinite(share) else f'{100 * share:.{digits}f} %'


def count(value: int | None) -> str:
    """A whole number in groups of three digits; a dash for nothing."""
    return DASH if value is None else f'{value:,}'.replace(',', '&thinsp;')
