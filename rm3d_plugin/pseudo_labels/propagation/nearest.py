"""The trivial answers: each point as the label nearest to it."""

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.structures import PointCloud

COLOUR_METRE = 1.0  # difference of a colour in [0, 1] that counts as a metre
_CHUNK = 1 << 15  # points whose distances to all labels are held at once


def nearest_label(
    xyz: Float[np.ndarray, 'points 3'], labelled: Int[np.ndarray, ' labelled'], classes: Int[np.ndarray, ' labelled']
) -> Int[np.ndarray, ' points']:
    """Class of the nearest labelled point; -1 where there is none."""
    if not len(labelled) or not len(xyz):
        return np.full(len(xyz), -1, dtype=np.int64)
    return np.asarray(classes[Octree(xyz[labelled]).knn(xyz, 1).indices[:, 0]], dtype=np.int64)


def nearest_label_in_place_and_colour(
    cloud: PointCloud, labelled: Int[np.ndarray, ' labelled'], classes: Int[np.ndarray, ' labelled']
) -> Int[np.ndarray, ' points']:
    """The same with three more coordinates: red, green and blue."""
    if cloud.colors is None or not len(labelled):
        return nearest_label(cloud.xyz, labelled, classes)
    place = np.concatenate([cloud.xyz - cloud.xyz[:1], COLOUR_METRE * cloud.colors], axis=1).astype(np.float64)
    others, out = place[labelled], np.empty(len(place), dtype=np.int64)
    norms = np.square(others).sum(axis=1)
    for first in range(0, len(place), _CHUNK):
        some = place[first : first + _CHUNK]
        out[first : first + _CHUNK] = classes[(norms - 2.0 * some @ others.T).argmin(axis=1)]
    return out
