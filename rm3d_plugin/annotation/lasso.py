"""A polygon that is clicked corner by corner in the picture."""

from typing import Any

import numpy as np

from rm3d_plugin.annotation.scan_picture import ScanPicture

CLOSES = 0.02  # of the picture: a click so near to the first corner closes it
BEFORE_EYE = 0.05  # of the distance to what is looked at: where it is drawn


class Lasso:
    """The corners so far, drawn in the scene.

    Args:
        picture: Of the scan.
    """

    def __init__(self, picture: ScanPicture) -> None:
        self._picture = picture
        self._corners: list[tuple[Any, np.ndarray]] = []  # place in the picture, place in the scene

    def closed_by(self, event: Any) -> bool:
        """Take a click as a corner; True where it closes the polygon instead, near the first corner."""
        place = np.asarray(event.screen_pos, dtype=np.float64)
        if len(self._corners) > 2 and np.abs(place - self._corners[0][0]).max() <= CLOSES:
            return True
        eye, way = np.asarray(event.ray_origin), np.asarray(event.ray_direction)
        length = float(np.linalg.norm(np.asarray(event.client.camera.look_at) - eye))
        self._corners.append((place, eye + BEFORE_EYE * length * way / np.linalg.norm(way)))
        self._picture.show_lasso(np.array([corner for _, corner in self._corners]))
        return False

    def close(self, client: Any) -> list[int]:
        """Points that lie in the polygon and that no other hides; it is gone then."""
        corners = np.array([place for place, _ in self._corners]).reshape(-1, 2)
        self._corners = []
        self._picture.show_lasso(np.zeros((0, 3)))
        return self._picture.in_lasso(client, corners) if len(corners) > 2 else []
