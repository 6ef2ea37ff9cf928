"""From the clicks on an object to its points, and from these to its box."""

import numpy as np
import scipy.sparse
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from rm3d_plugin.ops.octree import Octree
from rm3d_plugin.pseudo_labels.detection.boxes import BoxFit, complete_box, is_plausible, tight_box

WHOLE = 0.75  # share of the scan from which on no single object is meant


def object_points(
    xyz: Float[np.ndarray, 'points 3'],
    edges: scipy.sparse.csr_array,
    may_be: Bool[np.ndarray, ' points'],
    owner: Int[np.ndarray, ' points'],
    number: int,
) -> Int[np.ndarray, ' inside']:
    """Points of the object's class that are joined to its clicks, and nearer to these than to another object's.

    Args:
        xyz: Metres.
        edges: Between neighbours; weights do not count.
        may_be: Points that are of the object's class, as far as is known.
        owner: Object of each clicked point, -1 = none.
        number: Of the object; it has a click.
    """
    inside = np.flatnonzero(may_be | (owner == number))
    clicked = np.flatnonzero(owner >= 0)
    nearest = Octree(xyz[clicked]).knn(xyz[inside], 1).indices[:, 0]
    own = inside[(owner[clicked[nearest]] == number) & ((owner[inside] == number) | (owner[inside] < 0))]
    _, part = connected_components(edges[own][:, own], directed=False)
    return own[np.isin(part, np.unique(part[owner[own] == number]))]


def fit_object_box(
    points: Float[np.ndarray, 'points 3'],
    size: Float[np.ndarray, '3'] | None = None,
    sensor: tuple[float, float] | None = None,
) -> Float[np.ndarray, '7']:
    """The box of an object: turned as its sides are, and as large as its class usually is where less was seen.

    Args:
        points: Of the object, metres, at least one.
        size: Usual length, width and height of its class; None: unknown. Points that stretch farther are believed.
        sensor: Where the points were seen from; None: from all sides.
    """
    if size is None:
        return tight_box(points, sensor=sensor)
    fit: BoxFit = complete_box(points, size, sensor=sensor)
    return fit.box if is_plausible(fit, size) else tight_box(points, sensor=sensor)
