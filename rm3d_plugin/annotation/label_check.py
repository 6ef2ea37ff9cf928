"""Labels that the others contradict: clicks that may be mistakes."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.propagation.folds import label_folds
from rm3d_plugin.pseudo_labels.propagation.labels import Labels, one_of_each
from rm3d_plugin.pseudo_labels.propagation.live import LiveAnswer
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud

Ask = Callable[[Int[np.ndarray, ' labelled'], Int[np.ndarray, ' labelled']], LiveAnswer]
FOLDS = 10  # parts that are left out in turn


class LabelCheck(NamedTuple):
    """What the other labels say of each label.

    Attributes:
        points: (L,) labelled ones.
        places: (L,) of each; the labels of one place, as of a stroke, were left out together.
        said: (L,) class that the others name; a label whose class has no other place is not asked, and stands.
        own: (L,) share that the others give to the label's own class; NaN: it was not asked.
        share: (L,) share that they give to the class that they name.
    """

    points: Int[np.ndarray, ' labelled']
    places: Int[np.ndarray, ' labelled']
    said: Int[np.ndarray, ' labelled']
    own: Float[np.ndarray, ' labelled']
    share: Float[np.ndarray, ' labelled']


def check_given(
    scene: PreparedCloud, ask: Ask, points: Int[np.ndarray, ' labelled'], classes: Int[np.ndarray, ' labelled']
) -> LabelCheck:
    """Leave the labels out part by part, and ask the others.

    Args:
        scene: The scan.
        ask: What labels say of every point.
        points: Labelled ones, each once.
        classes: Of these.
    """
    labels = Labels.of(scene, points, classes, int(classes.max(initial=-1)) + 1)
    part = label_folds(labels, FOLDS, np.random.default_rng(0))
    said, own, share = classes.copy(), np.full(len(points), np.nan), np.ones(len(points))
    for number in np.unique(part[part >= 0]):
        left = part == number
        shares = ask(points[~left], classes[~left]).shares[points[left]]
        said[left], share[left] = shares.argmax(axis=1), shares.max(axis=1)
        own[left] = np.take_along_axis(shares, classes[left, None], axis=1)[:, 0]
    return LabelCheck(points, labels.places, said, own, share)


def contradicted(check: LabelCheck, classes: Int[np.ndarray, ' labelled']) -> Int[np.ndarray, ' rows']:
    """Rows of labels for which the others name another class, the surest first, one of each place.

    Args:
        check: Of the labels.
        classes: Of these.
    """
    rows = np.flatnonzero(check.said != classes)
    rows = rows[np.argsort(-check.share[rows], kind='stable')]
    return rows[one_of_each(check.places[rows])]
