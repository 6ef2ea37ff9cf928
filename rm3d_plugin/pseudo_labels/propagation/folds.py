"""Dividing labels into parts that are left out in turn."""

import numpy as np
from jaxtyping import Int

from rm3d_plugin.pseudo_labels.propagation.labels import Labels


def label_folds(labels: Labels, folds: int, generator: np.random.Generator) -> Int[np.ndarray, ' labelled']:
    """Part of each label; -1: never left out, since its class has one place alone.

    Stratified: the places of each class are dealt out in turn. Apart: the labels of one place are left out together, or
    a label would be judged by another beside it.

    Args:
        labels: Of a scan.
        folds: Parts.
        generator: Of the order.
    """
    out, offset = np.full(len(labels.classes), -1, dtype=np.int64), 0
    for own in np.unique(labels.classes):
        rows = np.flatnonzero(labels.classes == own)
        places, number = np.unique(labels.places[rows], return_inverse=True)
        if len(places) < 2:
            continue
        part = np.empty(len(places), dtype=np.int64)
        part[generator.permutation(len(places))] = (offset + np.arange(len(places))) % folds
        out[rows] = part[number]
        offset += len(places)  # the next class goes on where this one ended: parts of equal size
    return out
