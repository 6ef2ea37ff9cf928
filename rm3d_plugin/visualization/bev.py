"""Bird's-eye pictures of a scene: points by height, region or class, with boxes on top."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rm3d_plugin.structures import Boxes3D
from rm3d_plugin.visualization.palette import GREY, class_color, region_colors

TRUTH, BOX = '#111111', '#555555'  # of truth, and in a legend of boxes in the colours of classes
Span = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class BoxLayer:
    """Boxes to draw in one colour; a short line shows where each heads.

    Attributes:
        name: Words for the legend.
        boxes: The boxes.
        color: Any colour that matplotlib knows; None: each box has the colour of its class.
        style: '-' or '--'.
        scores: The score stands beside each box that has one.
    """

    name: str
    boxes: Boxes3D
    color: str | None
    style: str = '-'
    scores: bool = False


@dataclass(frozen=True, eq=False)
class BevPanel:
    """One square of the picture.

    Attributes:
        title: Words above it.
        xyz: (N, 3) metres, z up.
        colors: (N, 3) RGB in [0, 1] or None: grey.
        layers: Boxes on top, the last uppermost.
        legend: (colour, words) of point colours.
        legend_beside: The legend stands to the right of the square, where it hides nothing.
    """

    title: str
    xyz: Float[np.ndarray, 'points 3']
    colors: Float[np.ndarray, 'points 3'] | None = None
    layers: Sequence[BoxLayer] = ()
    legend: Sequence[tuple[str, str]] = ()
    legend_beside: bool = False


def class_point_colors(labels: Int[np.ndarray, ' points'], num_classes: int) -> Float[np.ndarray, 'points 3']:
    """Colour of each point's class; light grey for -1 and for anything from ``num_classes`` on (background)."""
    table = np.array([to_rgb(class_color(c)) for c in range(num_classes)] + [to_rgb('#dddddd')])
    labels = np.asarray(labels, dtype=np.int64)
    return table[np.where((labels < 0) | (labels >= num_classes), num_classes, labels)]


def footprints(boxes: Boxes3D) -> Float[np.ndarray, 'boxes 5 2']:
    """Closed outlines of the boxes seen from above, metres."""
    corners = boxes.corners()[:, :4, :2]
    return np.concatenate([corners, corners[:, :1]], axis=1)


def headings(boxes: Boxes3D) -> Float[np.ndarray, 'boxes 2 2']:
    """Lines from each box's centre to the middle of its front, metres."""
    front = boxes.corners()[:, :2, :2].mean(axis=1)
    return np.stack([boxes.tensor[:, :2], front], axis=1)


def span_of(panels: Sequence[BevPanel], margin: float = 2.0) -> Span:
    """(x low, y low, x high, y high) in metres that holds the bulk of the points and every box."""
    parts = [np.quantile(p.xyz[:, :2], (0.005, 0.995), axis=0) for p in panels if len(p.xyz)]
    parts += [footprints(layer.boxes).reshape(-1, 2) for p in panels for layer in p.layers if len(layer.boxes)]
    if not parts:
        return (-1.0, -1.0, 1.0, 1.0)
    every = np.concatenate(parts)
    low, high = every.min(axis=0) - margin, every.max(axis=0) + margin
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


@rc_context({'text.parse_math': False})  # names are words, not formulas
def draw_bev(
    panels: Sequence[BevPanel],
    span: Span | None = None,
    max_points: int = 40_000,
    width: float = 4.2,
    dpi: int = 110,
) -> bytes:
    """Draw panels side by side, all over the same ground.

    Args:
        panels: What to draw, left to right.
        span: (x low, y low, x high, y high) in metres; None: all of it.
        max_points: Points beyond this are thinned evenly; larger: slower and heavier.
        width: Inches a panel.
        dpi: Pixels an inch.

    Returns:
        The picture as PNG; equal input gives equal bytes.

    Raises:
        ValueError: No panel is given.
    """
    if not panels:
        raise ValueError('draw_bev: no panel to draw')
    span = span_of(panels) if span is None else span
    aspect = float(np.clip((span[3] - span[1]) / max(span[2] - span[0], 1e-6), 0.4, 2.0))
    figure = Figure(figsize=(width * len(panels), (width - 0.55) * aspect + 0.65), dpi=dpi, layout='constrained')
    canvas = FigureCanvasAgg(figure)
    for i, panel in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), i + 1)
        _draw_panel(axes, panel, span, max_points)
    stream = io.BytesIO()
    canvas.print_png(stream, metadata={'Software': None}, pil_kwargs={'optimize': True})
    return stream.getvalue()


def scene_panels(
    xyz: Float[np.ndarray, 'points 3'],
    classes: Sequence[str],
    regions: Int[np.ndarray, ' points'] | None = None,
    semantic: Int[np.ndarray, ' points'] | None = None,
    truth: Boxes3D | None = None,
    pseudo: Boxes3D | None = None,
    predicted: Boxes3D | None = None,
) -> list[BevPanel]:
    """The panels of a scene for which something is given: regions, pseudo labels, predictions.

    Truth lies below the other boxes, dashed and black.

    Args:
        xyz: (N, 3) metres.
        classes: Names of the classes of ``semantic``.
        regions: (N,) region of each point, -1 = discarded.
        semantic: (N,) pseudo label of each point, -1 = none.
        truth: True boxes.
        pseudo: True and pseudo boxes that training sees.
        predicted: Boxes that the network found.
    """
    known = [] if truth is None else [BoxLayer('truth', truth, TRUTH, '--')]
    panels = []
    if regions is not None:
        number = len(np.unique(regions[regions >= 0]))
        panels.append(BevPanel(f'{number} regions', xyz, region_colors(regions)))
    if semantic is not None or pseudo is not None:
        colors = None if semantic is None else class_point_colors(semantic, len(classes))
        legend = [] if semantic is None else [(class_color(c), name) for c, name in enumerate(classes)]
        layers = [] if pseudo is None else [BoxLayer('pseudo box', pseudo, None)]
        panels.append(BevPanel('Pseudo labels', xyz, colors, [*known, *layers], legend, legend_beside=True))
    if predicted is not None:
        layers = [*known, BoxLayer('predicted, with score', predicted, None, scores=True)]
        legend = [(class_color(c), name) for c, name in enumerate(classes)]
        panels.append(BevPanel('Predictions', xyz, None, layers, legend, legend_beside=True))
    return panels or [BevPanel('Scene', xyz, None, known)]


def _draw_panel(axes: Axes, panel: BevPanel, span: Span, max_points: int) -> None:
    step = max(1, -(-len(panel.xyz) // max_points))
    xyz = panel.xyz[::step]
    shade = GREY if panel.colors is None else panel.colors[::step]
    axes.scatter(xyz[:, 0], xyz[:, 1], s=0.7, c=shade, linewidths=0, rasterized=True)
    handles = [Line2D([], [], color=c, marker='o', linestyle='', markersize=5, label=n) for c, n in panel.legend]
    for layer in panel.layers:
        if len(layer.boxes):
            lines = [*footprints(layer.boxes), *headings(layer.boxes)]
            weight = 2.4 if layer.style == '--' else 1.2  # what lies below shows on both sides
            colors = layer.color or [class_color(c) for c in layer.boxes.labels.tolist()] * 2
            axes.add_collection(LineCollection(lines, colors=colors, linestyles=layer.style, linewidths=weight))
        label = f'{layer.name} ({len(layer.boxes)})'
        if layer.scores:
            _write_scores(axes, layer.boxes)
        handles.append(Line2D([], [], color=layer.color or BOX, linestyle=layer.style, label=label))
    axes.set_xlim(span[0], span[2])
    axes.set_ylim(span[1], span[3])
    axes.set_aspect('equal')
    axes.set_title(panel.title, fontsize=10)
    axes.set_xlabel('x (m)', fontsize=8)
    axes.set_ylabel('y (m)', fontsize=8)
    axes.tick_params(labelsize=7)
    if handles:
        beside: dict[str, Any] = {'loc': 'upper left', 'bbox_to_anchor': (1.01, 1.0), 'borderaxespad': 0}
        place = beside if panel.legend_beside else {'loc': 'upper right'}
        axes.legend(handles=handles, fontsize=7, framealpha=0.85, **place)


def _write_scores(axes: Axes, boxes: Boxes3D) -> None:
    if boxes.scores is None:
        return
    corner = footprints(boxes).max(axis=1)
    for (x, y), label, score in zip(corner.tolist(), boxes.labels.tolist(), boxes.scores.tolist(), strict=True):
        axes.text(x, y, f'{score:.2f}', fontsize=5, color=class_color(label), clip_on=True)
