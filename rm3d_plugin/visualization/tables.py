"""Figures of measured tables: bars beside each other, and curves, as PNG."""

import io
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rm3d_plugin.visualization.palette import class_color

MARKERS = ('o', 's', '^', 'D', 'v', 'P', 'X', '*')
DASHES = ('-', '--')  # the second eight lines, whose colours are less safe to tell apart, are dashed


class BarPanel(NamedTuple):
    """Bars of one panel.

    Attributes:
        title: Of the panel.
        names: One for each group of bars, from the top.
        bars: Legend -> a value for each name.
        ranges: Legend -> lowest and highest value for each name, drawn as a line on the bar.
    """

    title: str
    names: Sequence[str]
    bars: Mapping[str, Sequence[float]]
    ranges: Mapping[str, Sequence[tuple[float, float]]] = {}


class LinePanel(NamedTuple):
    """Curves of one panel.

    Attributes:
        title: Of the panel.
        x_label: With unit.
        ticks: Labels along x, evenly spaced.
        lines: Legend -> a value for each tick; NaN leaves a gap.
    """

    title: str
    x_label: str
    ticks: Sequence[str]
    lines: Mapping[str, Sequence[float]]


def draw_bars(panels: Sequence[BarPanel], label: str, dpi: int = 110) -> bytes:
    """Groups of horizontal bars, panels beside each other; equal input gives equal bytes.

    Args:
        panels: At least one.
        label: Of the values' axis, with unit.
        dpi: Pixels an inch.

    Raises:
        ValueError: There is no panel, or a panel has more or fewer values than names.
    """
    for panel in panels:
        if any(len(values) != len(panel.names) for values in panel.bars.values()):
            raise ValueError(f'draw_bars: panel {panel.title!r}: expected {len(panel.names)} values of each colour')
    groups = max((len(panel.names) for panel in panels), default=0)
    figure, rows = _figure(1, len(panels), (4.6, 0.4 * groups + 1.2), dpi)
    for axes, panel in zip(rows[0], panels, strict=True):
        height = 0.8 / max(len(panel.bars), 1)
        for i, (name, values) in enumerate(panel.bars.items()):
            places = np.arange(len(values)) + (i - (len(panel.bars) - 1) / 2) * height
            axes.barh(places, values, height, color=class_color(i), label=name)
            if name in panel.ranges:
                axes.hlines(places, *np.transpose(panel.ranges[name]), color='black', linewidth=0.8)
        axes.set_yticks(range(len(panel.names)), panel.names, fontsize=7)
        axes.invert_yaxis()
        _label(axes, panel.title, label)
    handles, names = rows[0][0].get_legend_handles_labels()
    figure.legend(handles, names, fontsize=7, frameon=False, loc='outside lower center', ncols=3)
    return _png(figure)


def draw_lines(panels: Sequence[Sequence[LinePanel]], label: str, dpi: int = 110) -> bytes:
    """Curves in rows of panels that share the values' axis; equal input gives equal bytes.

    Args:
        panels: Rows of equal length, at least one of each.
        label: Of the values' axis, with unit.
        dpi: Pixels an inch.

    Raises:
        ValueError: There is no panel, rows differ in length, or a curve has more or fewer values than ticks.
    """
    if len({len(row) for row in panels}) > 1:
        raise ValueError('draw_lines: rows of panels differ in length')
    figure, rows = _figure(len(panels), len(panels[0]) if panels else 0, (4.0, 3.0), dpi)
    for drawn, row in zip(rows, panels, strict=True):
        for axes, panel in zip(drawn, row, strict=True):
            for i, (name, values) in enumerate(panel.lines.items()):
                if len(values) != len(panel.ticks):
                    raise ValueError(f'draw_lines: {panel.title!r}, {name!r}: expected {len(panel.ticks)} values')
                (line,) = axes.plot(range(len(values)), values, color=class_color(i), linewidth=1.2, label=name)
                line.set(marker=MARKERS[i % len(MARKERS)], markersize=4, linestyle=DASHES[i // 8 % len(DASHES)])
            axes.set_xticks(range(len(panel.ticks)), panel.ticks, fontsize=7)
            _label(axes, panel.title, panel.x_label)
        drawn[0].set_ylabel(label, fontsize=8)
    rows[0][-1].legend(fontsize=7, frameon=False, loc='upper left', bbox_to_anchor=(1.01, 1.0))
    return _png(figure)


def _figure(rows: int, columns: int, size: tuple[float, float], dpi: int) -> tuple[Figure, list[list[Axes]]]:
    """A figure of so many panels; ``size`` in inches is that of one."""
    if not rows or not columns:
        raise ValueError('a figure needs at least one panel')
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), dpi=dpi, layout='constrained')
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    return figure, [list(row) for row in grid]


def _label(axes: Axes, title: str, x_label: str) -> None:
    axes.set_title(title, fontsize=9)
    axes.set_xlabel(x_label, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.canvas.print_png(stream, metadata={'Software': None}, pil_kwargs={'optimize': True})  # type: ignore[attr-defined]
    return stream.getvalue()
