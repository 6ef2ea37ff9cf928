"""Dividing labels into parts that are left out in turn."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

APART = 1.0  # spacings below which two labels of a class are one place, clicked twice: left out together


def label_folds(
    xyz: Float[np.ndarray, 'labelled 3'],
    classes: Int[np.ndarray, ' labelled'],
    spacing: float,
    folds: int,
    generator: np.random.Generator,
) -> Int[np.ndarray, ' labelled']:
    """Part of each label; -1: never left out, since its class has one place alone.

    Stratified: the places of each class are dealt out in turn. Apart: labels of a class within :data:`APART` spacings,
    one with the next, are one place, or a label would be judged by another beside it.

    Args:
        xyz: Metres.
        classes: From 0.
        spacing: Metres between points of the scan.
        folds: Parts.
        generator: Of the order.
    """
    place, out = _places(xyz, classes, APART * spacing), np.full(len(classes), -1, dtype=np.int64)
    offset = 0
    for own in np.unique(classes):
        places = generator.permutation(np.unique(place[classes == own]))
        if len(places) < 2:
            continue
        part = dict(zip(places.tolist(), (offset + np.arange(len(places))) % folds, strict=True))
        for row in np.flatnonzero(classes == own):
            out[row] = part[int(place[row])]
        offset += len(places)  # the next class goes on where this one ended: parts of equal size
    return out


def _places(
    xyz: Float[np.ndarray, 'labelled 3'], classes: Int[np.ndarray, ' labelled'], radius: float
) -> Int[np.ndarray, ' labelled']:
    pairs = cKDTree(xyz).query_pairs(radius, output_type='ndarray') if len(xyz) else np.zeros((0, 2), np.int64)
    pairs = pairs[classes[pairs[:, 0]] == classes[pairs[:, 1]]]
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(xyz), len(xyz)))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)
