"""Regions as a page with a 3D view that can be turned."""

from importlib import import_module
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.storage import write_text
from rm3d_plugin.visualization.palette import region_colors

MAX_POINTS = 150_000  # a browser turns so many without delay


def write_regions_page(
    path: str | Path,
    xyz: Float[np.ndarray, 'points 3'],
    labels: Int[np.ndarray, ' points'],
    title: str,
    max_points: int = MAX_POINTS,
) -> Path:
    """Write an HTML file that needs no network, points coloured by region.

    Args:
        path: The file.
        xyz: Metres.
        labels: Region of each point, -1 = discarded.
        title: Shown above the view.
        max_points: Of more points, every so-and-so-many-th is drawn, so that at most this many are.

    Raises:
        ImportError: plotly is not installed; the message tells how to get it.
    """
    try:
        plotly = import_module('plotly.graph_objects')
    except ImportError as error:
        raise ImportError(f'{path}: an HTML view needs plotly: pip install plotly (or write .ply or .npz)') from error
    shown = np.arange(0, len(xyz), max(1, -(-len(xyz) // max_points)))
    red_green_blue = np.round(region_colors(labels[shown]) * 255).astype(int)
    points = plotly.Scatter3d(
        x=xyz[shown, 0],
        y=xyz[shown, 1],
        z=xyz[shown, 2],
        mode='markers',
        marker={'size': 1.5, 'color': [f'rgb({r},{g},{b})' for r, g, b in red_green_blue]},
        text=[f'region {label}' for label in labels[shown]],
        hoverinfo='text',
    )
    figure = plotly.Figure(points)
    figure.update_layout(title=title, scene={'aspectmode': 'data'}, margin={'l': 0, 'r': 0, 'b': 0, 't': 40})
    return write_text(path, figure.to_html(include_plotlyjs=True))
