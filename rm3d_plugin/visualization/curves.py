"""Line charts as inline SVG that takes its colours of text and grid from the page, light or dark."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import NamedTuple

import numpy as np

from rm3d_plugin.visualization.palette import class_color

WIDTH, HEIGHT = 640, 300  # user units of the drawing
LEFT, RIGHT, TOP, BOTTOM = 56, 16, 14, 44
DASHES = ('', '6 3', '2 3', '8 3 2 3')  # a second cue beside colour


class Series(NamedTuple):
    """One line: equally many x and y; a y that is not finite leaves a gap."""

    x: Sequence[float]
    y: Sequence[float]


@dataclass(frozen=True)
class Chart:
    """A chart with its words.

    Attributes:
        title: Also read by screen readers.
        x_label: With unit.
        y_label: With unit.
        series: Lines by name, in order.
        marks: x of thin vertical lines (where a round begins, say).
        y_low: Least end of the y axis; None: from the data.
        small: One of several that stand side by side; the title names its only line, so there is no legend.
    """

    title: str
    x_label: str
    y_label: str
    series: Mapping[str, Series] = field(default_factory=dict)
    marks: Sequence[float] = ()
    y_low: float | None = None
    small: bool = False


def nice_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """About ``count`` round numbers (1, 2 or 5 times a power of ten apart) within [low, high].

    >>> nice_ticks(0, 1)
    [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    """
    if not high > low:
        return [low]
    raw = (high - low) / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(k * step, 12) + 0.0 for k in range(first, last + 1)]


def draw_chart(chart: Chart) -> str:
    """The chart as one ``<svg>`` element for an HTML page; what has no finite point is left out.

    Raises:
        ValueError: A line has unequally many x and y.
    """
    lines: dict[str, np.ndarray] = {}
    for name, line in chart.series.items():
        if len(line.x) != len(line.y):
            raise ValueError(f'chart {chart.title!r}, line {name!r}: {len(line.x)} x, {len(line.y)} y')
        lines[name] = np.array([line.x, line.y], dtype=np.float64).reshape(2, -1).T
    finite = [xy[np.isfinite(xy).all(axis=1)] for xy in lines.values()]
    every = np.concatenate([np.zeros((0, 2)), *finite])
    if len(every) == 0:
        return f'<p class="empty">{escape(chart.title)}: nothing was recorded.</p>'
    (x_low, y_low), (x_high, y_high) = every.min(axis=0), every.max(axis=0)
    y_low = y_low if chart.y_low is None else min(chart.y_low, y_low)
    frame = _Frame(*_open_range(x_low, x_high), *_open_range(y_low, y_high))
    body = [*_axes(chart, frame)]
    body += [_polylines(xy, frame, i) for i, xy in enumerate(lines.values())]
    drawing = ''.join(body)
    legend = '' if chart.small else ''.join(_legend_item(name, i) for i, name in enumerate(lines))
    legend = legend and f'<ul class="legend">{legend}</ul>'
    return (
        f'<figure class="chart"><figcaption>{escape(chart.title)}</figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(_describe(chart, lines))}">{drawing}</svg>'
        f'{legend}</figure>'
    )


class _Frame(NamedTuple):
    x_low: float
    x_high: float
    y_low: float
    y_high: float

    def x(self, value: float) -> float:
        return LEFT + (value - self.x_low) / (self.x_high - self.x_low) * (WIDTH - LEFT - RIGHT)

    def y(self, value: float) -> float:
        return HEIGHT - BOTTOM - (value - self.y_low) / (self.y_high - self.y_low) * (HEIGHT - TOP - BOTTOM)


def _open_range(low: float, high: float) -> tuple[float, float]:
    if high > low:
        return float(low), float(high)
    pad = abs(low) * 0.1 or 1.0
    return float(low) - pad, float(high) + pad


def _axes(chart: Chart, frame: _Frame) -> list[str]:
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
    out = []
    for value in nice_ticks(frame.y_low, frame.y_high):
        y = frame.y(value)
        out.append(f'<line class="grid" x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
        out.append(f'<text class="tick" x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    for value in nice_ticks(frame.x_low, frame.x_high, 8):
        x = frame.x(value)
        out.append(f'<text class="tick" x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{value:g}</text>')
    for value in chart.marks:
        if frame.x_low <= value <= frame.x_high:
            x = frame.x(value)
            out.append(f'<line class="mark" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{bottom}"/>')
    out.append(f'<line class="axis" x1="{LEFT}" x2="{right}" y1="{bottom}" y2="{bottom}"/>')
    middle = (LEFT + right) / 2
    out.append(f'<text class="name" x="{middle}" y="{HEIGHT - 6}" text-anchor="middle">{escape(chart.x_label)}</text>')
    up = (TOP + bottom) / 2
    out.append(
        f'<text class="name" x="14" y="{up}" text-anchor="middle" transform="rotate(-90 14 {up})">'
        f'{escape(chart.y_label)}</text>'
    )
    return out


def _polylines(xy: np.ndarray, frame: _Frame, number: int) -> str:
    style = f'stroke="{class_color(number)}" stroke-dasharray="{DASHES[number // 8 % len(DASHES)]}"'
    finite = np.isfinite(xy).all(axis=1)
    out = []
    for piece in np.split(np.arange(len(xy)), np.flatnonzero(np.diff(finite.astype(int))) + 1):
        if len(piece) == 0 or not finite[piece[0]]:
            continue
        points = [(frame.x(a), frame.y(b)) for a, b in xy[piece]]
        if len(points) > 1:
            path = ' '.join(f'{a:.1f},{b:.1f}' for a, b in points)
            out.append(f'<polyline class="line" points="{path}" {style}/>')
        if len(points) <= 30:
            dots = ''.join(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3"/>' for a, b in points)
            out.append(f'<g fill="{class_color(number)}">{dots}</g>')
    return ''.join(out)


def _legend_item(name: str, number: int) -> str:
    return f'<li><span class="swatch" style="background:{class_color(number)}"></span>{escape(name)}</li>'


def _describe(chart: Chart, lines: Mapping[str, np.ndarray]) -> str:
    ends = []
    for name, xy in lines.items():
        rows = xy[np.isfinite(xy).all(axis=1)]
        if len(rows):
            ends.append(f'{name} from {rows[0, 1]:.4g} to {rows[-1, 1]:.4g}')
    return f'{chart.title}: {"; ".join(ends)}'
