"""One renderer for all tables: markdown, CSV, JSON, LaTeX and a figure."""

import csv
import io
import json
import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from rm3d_plugin.storage import atomic_write
from rm3d_plugin.storage.files import plain_json
from rm3d_plugin.visualization.tables import BarPanel, draw_bars

Format = Literal['md', 'csv', 'json', 'tex', 'png']
FORMATS: tuple[Format, ...] = get_args(Format)
_LATEX = {
    '\\': r'\textbackslash{}', '&': r'\&', '%': r'\%', '$': r'\$', '#': r'\#', '_': r'\_', '{': r'\{', '}': r'\}',
    '~': r'\textasciitilde{}', '^': r'\textasciicircum{}',
}  # fmt: skip


class Cell(NamedTuple):
    """One place of a table.

    Attributes:
        text: As it is printed.
        values: What was measured, one value a seed or scene; none where the text says all.
    """

    text: str
    values: tuple[float, ...] = ()


class NamedRow(NamedTuple):
    """A row: its name, and a cell for each further column."""

    name: str
    cells: tuple[Cell, ...]


class Section(NamedTuple):
    """Rows under one heading.

    Attributes:
        title: Above them; '' for none.
        columns: Headings; the first is that of the rows' names.
        rows: From the top.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[NamedRow, ...]


@dataclass(frozen=True)
class FilledTable:
    """A table with its numbers.

    Attributes:
        title: One line.
        notes: Further lines, on how it was measured.
        sections: What markdown, LaTeX and JSON show.
        records: Every single measurement, for CSV and JSON.
        figure: Draws the PNG.
    """

    title: str
    notes: tuple[str, ...]
    sections: tuple[Section, ...]
    records: tuple[Mapping[str, Any], ...]
    figure: Callable[[], bytes]


def to_format(table: FilledTable, format: Format) -> bytes:
    """The table as a file of a format holds it."""
    if format == 'png':
        return table.figure()
    texts: dict[Format, Callable[[FilledTable], str]] = {
        'md': to_markdown,
        'csv': to_csv,
        'json': to_json,
        'tex': to_latex,
    }
    return texts[format](table).encode()


def save(table: FilledTable, out: Path, name: str) -> list[Path]:
    """Write ``out/name`` in every format; returns the files."""
    return [_write(out / f'{name}.{format}', to_format(table, format)) for format in FORMATS]


def to_markdown(table: FilledTable) -> str:
    """Title, notes, and a markdown table a section."""
    lines = [table.title, *table.notes]
    for section in table.sections:
        lines += ['', f'**{section.title}**'] * bool(section.title)
        lines += ['', f'| {" | ".join(section.columns)} |', '|---' * len(section.columns) + '|']
        lines += [f'| {" | ".join([name, *(cell.text for cell in cells)])} |' for name, cells in section.rows]
    return '\n'.join(lines) + '\n'


def to_csv(table: FilledTable) -> str:
    """Every single measurement in full precision, under the names of its values."""
    text = io.StringIO()
    names = dict.fromkeys(name for record in table.records for name in record)
    writer = csv.DictWriter(text, list(names), restval='', lineterminator='\n')
    writer.writeheader()
    writer.writerows(table.records)
    return text.getvalue()


def to_json(table: FilledTable) -> str:
    """Title, notes, sections (cells with text and values) and records; NaN is null."""
    sections = [
        {
            'title': section.title,
            'columns': section.columns,
            'rows': [{'name': name, 'cells': [cell._asdict() for cell in cells]} for name, cells in section.rows],
        }
        for section in table.sections
    ]
    content = {'title': table.title, 'notes': table.notes, 'sections': sections, 'records': table.records}
    return json.dumps(plain_json(content), indent=2, ensure_ascii=False, allow_nan=False) + '\n'


def to_latex(table: FilledTable) -> str:
    """A table environment a section, for the package booktabs; notes are comments."""
    lines = [f'% {line}' for line in (table.title, *table.notes)]
    for section in table.sections:
        caption = f'{table.title}; {section.title}' if section.title else table.title
        body = [_latex_line([name, *(cell.text for cell in cells)]) for name, cells in section.rows]
        lines += [
            r'\begin{table}',
            r'\centering',
            rf'\caption{{{escape_latex(caption)}}}',
            rf'\begin{{tabular}}{{l{"r" * (len(section.columns) - 1)}}}',
            r'\toprule',
            _latex_line(section.columns),
            r'\midrule',
            *body,
            r'\bottomrule',
            r'\end{tabular}',
            r'\end{table}',
        ]
    return '\n'.join(lines) + '\n'


def escape_latex(text: str) -> str:
    r"""Text as LaTeX prints it.

    >>> print(escape_latex('50 % of a_b & {c}'))
    50 \% of a\_b \& \{c\}
    """
    return re.sub(r'[\\&%$#_{}~^]', lambda match: _LATEX[match[0]], text)


def bar_figure(sections: Sequence[Section], columns: int, label: str) -> bytes:
    """Bars of the first columns' means, each with its lowest and highest value; a panel a section.

    Args:
        sections: Of a table; their cells hold values.
        columns: How many columns, beside the names of the rows.
        label: Of the values' axis, with unit.
    """
    return draw_bars([_panel(section, columns) for section in sections], label)


def _panel(section: Section, columns: int) -> BarPanel:
    cells = {head: [row.cells[i] for row in section.rows] for i, head in enumerate(section.columns[1 : columns + 1])}
    return BarPanel(
        section.title,
        [row.name for row in section.rows],
        {head: [statistics.mean(cell.values) for cell in column] for head, column in cells.items()},
        {head: [(min(cell.values), max(cell.values)) for cell in column] for head, column in cells.items()},
    )


def _write(path: Path, content: bytes) -> Path:
    return atomic_write(path, lambda file: file.write(content))


def _latex_line(cells: Sequence[str]) -> str:
    return ' & '.join(map(escape_latex, cells)) + r' \\'
