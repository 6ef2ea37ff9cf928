"""A scan in the scene of the page: its points, marks on them, boxes, and which points a person means."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8
from viser.transforms import SO3

from rm3d_plugin.annotation.annotated_scan import AnnotatedScan
from rm3d_plugin.annotation.point_view import (
    SHOWN,
    Camera,
    clearest_way,
    point_hit,
    points_in_lasso,
    points_in_rectangle,
)
from rm3d_plugin.structures import Boxes3D

MOST_DOTS = 5000  # labelled points that are marked, at most
DOTS_APART = 20  # times the distance between points: of a class one dot in a cell so wide
MARK = 'suggestion'
NEAR = 60  # times the distance between points: from there a suggestion is looked at
EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])


class View(NamedTuple):
    """Where a scan is looked at from: metres, in the frame of its points."""

    look_at: Float[np.ndarray, '3']
    position: Float[np.ndarray, '3']


class ScanPicture:
    """What of a scan is shown; points are numbers of the file everywhere.

    Attributes:
        shown: Points of the picture, after :meth:`show`.
        dots: Where labels were given, after :meth:`show_clicked`.

    Args:
        server: Of the page.
    """

    def __init__(self, server: Any) -> None:
        self._scene = server.scene
        self._mark: Any = None

    def show(self, scan: AnnotatedScan, size: float, heights: tuple[float, float], most: int = SHOWN) -> None:
        """Choose the points that are shown; :meth:`paint` sends them.

        Args:
            scan: The scan.
            size: Of a point; 1: as wide as the gaps between points.
            heights: Percent of the points that are below the lowest and the highest one shown.
            most: Points that are shown, at most.
        """
        self._xyz, self._spacing = scan.cloud.xyz, scan.scene.spacing
        low, high = np.percentile(self._xyz[:, 2], np.asarray(heights, dtype=np.float64))
        step = -int(-len(self._xyz) // most)
        every = np.arange(0, len(self._xyz), step)
        self.shown: Int[np.ndarray, ' shown'] = every[(self._xyz[every, 2] >= low) & (self._xyz[every, 2] <= high)]
        self._width = size * self._spacing * float(np.sqrt(step)) / 2  # half of what is drawn, as viser counts
        self._cloud: Any = None

    def paint(self, colors: UInt8[np.ndarray, 'shown 3']) -> None:
        """Send the points that are chosen, or their colours alone where they are there already."""
        if self._cloud is None:
            self._cloud = self._points('scan', self.shown, colors, self._width)
        else:
            self._cloud.colors = colors

    def show_clicked(self, annotated: Int[np.ndarray, ' points']) -> None:
        """Show where labels were given: a dot for each click, and few for a stroke, which would hide the scan."""
        points = np.flatnonzero(annotated >= 0)
        points = points[:: -(-len(points) // MOST_DOTS) or 1]
        if not len(points):
            self._scene.remove_by_name('clicks')
            return
        cells = np.floor(self._xyz[points] / (DOTS_APART * self._spacing))
        points = points[np.unique(np.column_stack([cells, annotated[points]]), axis=0, return_index=True)[1]]
        white = np.full((len(points), 3), 255, np.uint8)
        self.dots: Any = self._points('clicks', points, white, 3 * self._width)

    def _points(self, name: str, points: np.ndarray, colors: np.ndarray, width: float) -> Any:
        return self._scene.add_point_cloud(
            name, self._xyz[points], colors, point_size=width, point_shape='circle', precision='float32'
        )

    def show_boxes(self, boxes: Mapping[int, np.ndarray], colors: Mapping[int, tuple[int, int, int]]) -> None:
        """Draw boxes by number of their object, each in a colour; rows are in the frame of the points."""
        rows = np.array(list(boxes.values())).reshape(-1, 7)
        corners = Boxes3D(rows, np.zeros(len(rows), dtype=np.int64)).corners()
        edges = corners[:, EDGES].reshape(-1, 2, 3)
        painted = np.repeat(np.array([colors[number] for number in boxes]).reshape(-1, 3), 2 * len(EDGES), axis=0)
        self._lines('boxes', edges, painted.reshape(-1, 2, 3))

    def show_lasso(self, corners: Float[np.ndarray, 'corners 3']) -> None:
        """Draw the open polygon of a lasso."""
        ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1) if len(corners) > 1 else np.zeros((0, 2, 3))
        self._lines('lasso', ends, np.full((len(ends), 2, 3), 255))

    def _lines(self, name: str, ends: np.ndarray, colors: np.ndarray) -> None:
        visible = len(ends) > 0
        if not visible:
            ends, colors = np.zeros((1, 2, 3)), np.zeros((1, 2, 3))
        self._scene.add_line_segments(
            name, ends.astype(np.float32), colors.astype(np.uint8), thickness=2.0, thickness_units='screen',
            visible=visible,
        )  # fmt: skip

    # ------------------------------------------------------------------ what a person points at

    def met(self, event: Any) -> int | None:
        """The point that a click meets."""
        row = point_hit(self._xyz[self.shown], event.ray_origin, event.ray_direction, 2 * self._width)
        return None if row is None else int(self.shown[row])

    def in_rectangle(self, event: Any) -> list[int]:
        """Points in a dragged rectangle that no other hides."""
        rows = points_in_rectangle(self._xyz[self.shown], camera_of(event.client), event.screen_min, event.screen_max)
        return self.shown[rows].tolist()

    def in_lasso(self, client: Any, corners: Float[np.ndarray, 'corners 2']) -> list[int]:
        """Points in a polygon of the picture of a client that no other hides."""
        return self.shown[points_in_lasso(self._xyz[self.shown], camera_of(client), corners)].tolist()

    # ------------------------------------------------------------------ where to look

    def overview(self) -> View:
        """From above and a side."""
        low, high = np.quantile(self._xyz, [0.02, 0.98], axis=0)
        middle, reach = (low + high) / 2, float(np.linalg.norm(high - low))
        return View(middle, middle + reach * np.array([0.15, -0.45, 0.75]))

    def mark(self, point: int) -> None:
        """Put a red ball on a point."""
        place = self._xyz[point].astype(np.float64)
        self._mark = self._scene.add_icosphere(
            MARK, radius=3 * self._spacing, color=(255, 64, 64), position=place, opacity=0.6
        )

    def forget_mark(self) -> None:
        """Take the ball away."""
        if self._mark is not None:
            self._mark.remove()
            self._mark = None

    def look_at(self, client: Any, point: int) -> None:
        """Turn the camera of a client to a point, and bring it near, where little is in between."""
        place = self._xyz[point].astype(np.float64)
        away = np.asarray(client.camera.position) - place
        away = away if away.any() else np.array([0.0, 0.0, 1.0])
        length = min(float(np.linalg.norm(away)), NEAR * self._spacing)
        client.camera.position = place + length * clearest_way(self._xyz[self.shown], place, away, length)
        client.camera.look_at = place  # after the position, which takes it along


def camera_of(client: Any) -> Camera:
    """The camera of a client of the page."""
    camera = client.camera
    rotation = SO3(np.asarray(camera.wxyz)).as_matrix()
    return Camera(np.asarray(camera.position), rotation, float(camera.fov), float(camera.aspect))
