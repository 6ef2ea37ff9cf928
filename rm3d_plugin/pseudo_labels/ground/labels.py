"""Ground: road and pavement lie in one plane, and no region ends where they meet, but for a step of the kerb."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from rm3d_plugin.pseudo_labels.common.distance_prior import distance_decay
from rm3d_plugin.pseudo_labels.common.groups import seen_rows
from rm3d_plugin.structures import UNLABELLED, RegionGraph

STEP = 0.03  # m of height that count as a metre sideways: a kerb keeps two classes apart
FAR = 20.0  # m of that distance, from which on none is farther


def ground_regions(graph: RegionGraph, min_upright: float | None) -> Bool[np.ndarray, ' regions']:
    """Regions whose mean unit normal is upright: its height is at least ``min_upright``; None: no region is."""
    return np.asarray(np.abs(graph.normals[:, 2]) >= (np.inf if min_upright is None else min_upright))


class GroundLabels(NamedTuple):
    """What ground points are.

    Attributes:
        classes: (N,) int64; -1 for other points and where nothing is known.
        confidence: (N,) in [0, 1]; 0 where there is no class.
    """

    classes: Int[np.ndarray, ' points']
    confidence: Float[np.ndarray, ' points']


def nearest_ground_labels(
    xyz: Float[np.ndarray, 'points 3'],
    ground: Bool[np.ndarray, ' points'],
    annotated: Int[np.ndarray, ' points'],
    probabilities: Float[np.ndarray, 'points classes'] | None,
    max_distance: float | None,
) -> GroundLabels:
    """The class of each ground point: the nearest annotated one's, or what a network and the distances say together.

    Heights count 1 / :data:`STEP` times. With a network each class has its probability times what its nearest annotated
    ground point is worth from there (:func:`~rm3d_plugin.pseudo_labels.common.distance_prior.distance_decay`, 1 m), at
    least as at :data:`FAR`; classes without any are not said.

    Args:
        xyz: Metres, z up.
        ground: Points that take part.
        annotated: Annotated class of each point, -1 = none. Where no ground point has one, nothing is named.
        probabilities: (N, C) softmax, NaN or zero rows where the network saw nothing; None before there is a network.
        max_distance: Metres; without a network larger distances name nothing. None: no limit.

    >>> xyz = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0.15], [5, 0, 0.15]])
    >>> ground, known = np.ones(4, dtype=bool), np.array([3, -1, -1, 4])
    >>> nearest_ground_labels(xyz, ground, known, None, None).classes
    array([3, 3, 4, 4])
    """
    classes, confidence = np.full(len(xyz), UNLABELLED, dtype=np.int64), np.zeros(len(xyz))
    rows, own = np.flatnonzero(ground), np.flatnonzero(ground & (annotated >= 0))
    if not len(own):
        return GroundLabels(classes, confidence)
    where = xyz / np.array([1.0, 1.0, STEP])
    if probabilities is None:
        distance, nearest = cKDTree(where[own]).query(
            where[rows], distance_upper_bound=np.inf if max_distance is None else max_distance
        )
        near = np.isfinite(distance)
        classes[rows[near]], confidence[rows[near]] = annotated[own[nearest[near]]], 1.0
        return GroundLabels(classes, confidence)
    rows = rows[seen_rows(probabilities[rows])]
    if not len(rows):
        return GroundLabels(classes, confidence)
    said = probabilities[rows]
    shares = np.zeros_like(said)
    for c in np.unique(annotated[own]).tolist():
        distance, _ = cKDTree(where[own[annotated[own] == c]]).query(where[rows])
        shares[:, c] = said[:, c] * distance_decay(np.minimum(distance, FAR), 1.0)
    classes[rows] = shares.argmax(axis=1)
    confidence[rows] = shares.max(axis=1) / np.maximum(shares.sum(axis=1), 1e-12)
    return GroundLabels(classes, confidence)
