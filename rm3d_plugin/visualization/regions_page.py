"""Regions as a page with a 3D view that can be turned."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.storage import write_text
from rm3d_plugin.visualization.report_sections import page, section
from rm3d_plugin.visualization.scene_view import MAX_POINTS, Layer, SceneView, pack_views, view_block


def write_regions_page(
    path: str | Path,
    xyz: Float[np.ndarray, 'points 3'],
    labels: Int[np.ndarray, ' points'],
    title: str,
    layers: Sequence[Layer] = (),
    notes: Sequence[str] = (),
    max_points: int = MAX_POINTS,
) -> Path:
    """Write an HTML file that needs no network, points coloured by region.

    Args:
        path: The file.
        xyz: Metres.
        labels: Region of each point, -1 = discarded; from 65535 on, numbers begin again.
        title: Shown above the view.
        layers: Further colourings, the scan's own colours and heights, say.
        notes: Sentences above the view.
        max_points: Of more points, every so-and-so-many-th is drawn, so that at most this many are.
    """
    packed = pack_views([SceneView(title, xyz, [Layer('region', 'number', labels), *layers])], (), max_points)
    return write_text(path, page(title, False, notes, [section('turn', 'Regions to turn', view_block(packed))]))
