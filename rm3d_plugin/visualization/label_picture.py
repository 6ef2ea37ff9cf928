"""Which points of a scene are labelled, seen from above."""

import io
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from rm3d_plugin.structures import Boxes3D, PointCloud
from rm3d_plugin.visualization.bev import BevPanel, BoxLayer, Span, footprints, span_of
from rm3d_plugin.visualization.palette import SERIES, class_color

MARKERS = ('o', 's', '^', 'D', 'v', 'P', 'X', '*')  # a class has a colour and, after eight classes, another mark
MANY = 2000  # labelled points from which on marks would hide each other, so that dots are drawn


@rc_context({'text.parse_math': False})  # names are words, not formulas
def draw_label_picture(
    cloud: PointCloud,
    semantic: Int[np.ndarray, ' points'],
    classes: Sequence[str],
    boxes: Boxes3D | None = None,
    max_points: int = 40_000,
    width: float = 7.5,
    dpi: int = 110,
) -> bytes:
    """Draw a scene from above in pale colours, with its labelled points (and boxes) marked by class.

    Args:
        cloud: The scene.
        semantic: Annotated class of each point, -1 = none.
        classes: Class names; the legend tells how many points of each are labelled. A number beyond them is background.
        boxes: Annotated boxes, or None.
        max_points: Of more points, every so-and-so-many-th is drawn; labelled ones up to this number for each class.
        width: Inches.
        dpi: Pixels an inch.

    Returns:
        The picture as PNG; equal input gives equal bytes.
    """
    boxes = Boxes3D.empty() if boxes is None else boxes
    span = _span(cloud, np.asarray(semantic), boxes)
    size = max(span[2] - span[0], 1e-6), max(span[3] - span[1], 1e-6)
    height = float(np.clip((width - 2.2) * size[1] / size[0] + 0.6, 2.4, 12.0))
    figure = Figure(figsize=(width, height), dpi=dpi, layout='constrained')
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_subplot(1, 1, 1)
    _draw_scene(axes, cloud, max_points)
    _draw_labels(axes, cloud, np.asarray(semantic), classes, max_points)
    _draw_boxes(axes, boxes)
    axes.set_xlim(span[0], span[2])
    axes.set_ylim(span[1], span[3])
    axes.set_aspect('equal')
    axes.set_xlabel('x (m)', fontsize=8)
    axes.set_ylabel('y (m)', fontsize=8)
    axes.tick_params(labelsize=7)
    if axes.get_legend_handles_labels()[0]:
        legend = axes.legend(fontsize=7, loc='upper left', bbox_to_anchor=(1.01, 1.0), borderaxespad=0, frameon=False)
        for mark in legend.legend_handles:
            if mark is not None and hasattr(mark, 'set_sizes'):
                mark.set_sizes([26.0])
    stream = io.BytesIO()
    canvas.print_png(stream, metadata={'Software': None}, pil_kwargs={'optimize': True})
    return stream.getvalue()


def _span(cloud: PointCloud, semantic: Int[np.ndarray, ' points'], boxes: Boxes3D) -> Span:
    """The bulk of the points, every box, and every labelled point."""
    low_x, low_y, high_x, high_y = span_of([BevPanel('', cloud.xyz, layers=[BoxLayer('', boxes, 'k')])], margin=0.3)
    labelled = cloud.xyz[semantic >= 0]
    if len(labelled) == 0:
        return low_x, low_y, high_x, high_y
    low, high = labelled.min(axis=0) - 0.3, labelled.max(axis=0) + 0.3
    return (
        min(low_x, float(low[0])),
        min(low_y, float(low[1])),
        max(high_x, float(high[0])),
        max(high_y, float(high[1])),
    )


def _draw_scene(axes: Axes, cloud: PointCloud, max_points: int) -> None:
    rows = _thinned(np.argsort(cloud.xyz[:, 2], kind='stable'), max_points)  # the highest on top
    colors = _pale(cloud, rows)
    axes.scatter(cloud.xyz[rows, 0], cloud.xyz[rows, 1], s=0.7, c=colors, linewidths=0, rasterized=True)


def _draw_labels(
    axes: Axes, cloud: PointCloud, semantic: Int[np.ndarray, ' points'], classes: Sequence[str], max_points: int
) -> None:
    many = int((semantic >= 0).sum()) > MANY
    size, edge = (1.2, 0.0) if many else (26.0, 0.6)
    for number in np.unique(semantic[semantic >= 0]).tolist():
        rows = np.flatnonzero(semantic == number)
        name = classes[number] if number < len(classes) else 'background'
        drawn = _thinned(rows, max_points)
        axes.scatter(
            cloud.xyz[drawn, 0],
            cloud.xyz[drawn, 1],
            s=size,
            c=class_color(number),
            marker=MARKERS[number // len(SERIES) % len(MARKERS)],
            linewidths=edge,
            edgecolors='black',
            label=f'{name} ({len(rows)})',
            zorder=3,
        )


def _draw_boxes(axes: Axes, boxes: Boxes3D) -> None:
    if len(boxes):
        colors = [class_color(number) for number in boxes.labels.tolist()]
        lines = LineCollection(list(footprints(boxes)), colors=colors, linewidths=1.6, label=f'boxes ({len(boxes)})')
        axes.add_collection(lines)


def _thinned(rows: Int[np.ndarray, ' rows'], count: int) -> Int[np.ndarray, ' kept']:
    return rows[:: max(1, -(-len(rows) // count))]


def _pale(cloud: PointCloud, rows: Int[np.ndarray, ' rows']) -> Float[np.ndarray, 'rows 3']:
    """The scan's own colours, or grey by height, so light that marks stand out."""
    if cloud.colors is not None:
        own = cloud.colors[rows]
        return 0.55 + 0.45 * own.mean(axis=1, keepdims=True) * 0.5 + 0.225 * own
    height = cloud.xyz[rows, 2]
    low, high = np.quantile(height, (0.02, 0.98)) if len(height) else (0.0, 1.0)
    level = np.clip((height - low) / max(high - low, 1e-6), 0, 1)
    return np.repeat(0.62 + 0.28 * level[:, None], 3, axis=1)
