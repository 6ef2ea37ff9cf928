"""Scenes with boxes to turn in the browser: the edges of boxes are dotted lines among the points."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.reporting.scenes import own_colors
from rm3d_plugin.structures import Boxes3D, PointCloud
from rm3d_plugin.visualization.bev import class_point_colors
from rm3d_plugin.visualization.scene_view import Layer, SceneView

EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
DOTS = 40  # of an edge
CLOUD_POINTS = 40_000  # beside the dots
TRUTH = 'truth'  # its dots are black, those of all other boxes have the colour of their class
PALE = 0.45  # share of white that the scan's own colours are mixed with, so that boxes stand out


def edge_dots(boxes: Boxes3D) -> Float[np.ndarray, 'dots 3']:
    """Dots along the edges of the boxes, DOTS for each edge, box by box."""
    corners = boxes.corners().astype(np.float64)
    first, last = corners[:, EDGES[:, 0], None], corners[:, EDGES[:, 1], None]
    steps = np.linspace(0.0, 1.0, DOTS)[:, None]
    return (first + steps * (last - first)).reshape(-1, 3)


def box_view(title: str, cloud: PointCloud, boxes: Mapping[str, Boxes3D], classes: Sequence[str]) -> SceneView:
    """A scene with boxes: all together over the scan, then each set alone by class.

    Args:
        title: Words for the scene; the sets and their numbers follow.
        cloud: Its points.
        boxes: Sets of boxes by name; :data:`TRUTH` is drawn black.
        classes: Class names.
    """
    step = max(1, -(-len(cloud) // CLOUD_POINTS))
    xyz, colors = cloud.xyz[::step].astype(np.float64), own_colors(cloud)[::step]
    dots = {name: edge_dots(each) for name, each in boxes.items()}
    numbers = {name: np.repeat(each.labels, len(EDGES) * DOTS) for name, each in boxes.items()}
    parts = [PALE + (1 - PALE) * colors]
    parts += [
        np.zeros((len(number), 3)) if name == TRUTH else class_point_colors(number, len(classes))
        for name, number in numbers.items()
    ]
    layers = [Layer('all boxes', 'rgb', np.concatenate(parts))]
    layers += [Layer(name, 'class', _alone(name, numbers, len(xyz))) for name in boxes]
    told = ', '.join(f'{len(each)} {name}' for name, each in boxes.items())
    return SceneView(f'{title}: {told}', np.concatenate([xyz, *dots.values()]), layers)


def _alone(name: str, numbers: Mapping[str, np.ndarray], points: int) -> Int[np.ndarray, ' rows']:
    """Class of the dots of one set; -1 for all else."""
    rest = [number if each == name else np.full(len(number), -1) for each, number in numbers.items()]
    return np.concatenate([np.full(points, -1), *rest]).astype(np.int64)
