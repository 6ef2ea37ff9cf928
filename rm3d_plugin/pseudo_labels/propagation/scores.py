"""mIoU of the propagation beside the trivial answers, on a scan whose classes are known."""

import time
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from rm3d_plugin.pseudo_labels.propagation.nearest import nearest_label, nearest_label_in_place_and_colour
from rm3d_plugin.pseudo_labels.propagation.prepared import PreparedCloud
from rm3d_plugin.pseudo_labels.propagation.propagate import Propagation, propagate_prepared
from rm3d_plugin.pseudo_labels.propagation.rules import WalkerRules
from rm3d_plugin.structures import UNLABELLED

Budget = Literal['one a class', 'twenty a scan', 'twenty a class']
BUDGETS: tuple[Budget, ...] = get_args(Budget)
TWENTY = 20


class PropagationScores(NamedTuple):
    """Mean IoU, percent, over the classes that are there, on the points that were not labelled.

    Attributes:
        nearest: Each point as the nearest labelled one.
        place_and_colour: The same with colours as coordinates; NaN without colours.
        propagated: Ours.
        result: What ours says, its estimate among it.
        seconds: Ours took, without the preparation of the scan.
    """

    nearest: float
    place_and_colour: float
    propagated: float
    result: Propagation
    seconds: float


def propagation_scores(
    scene: PreparedCloud,
    semantic: Int[np.ndarray, ' points'],
    clicked: Int[np.ndarray, ' clicked'],
    rules: WalkerRules | None = None,
) -> PropagationScores:
    """Propagate the true classes of some points, and compare with those of the others.

    Args:
        scene: The scan.
        semantic: True class of each point, -1 = unknown.
        clicked: Points whose class is shown.
        rules: Of the propagation.
    """
    began = time.perf_counter()
    result = propagate_prepared(scene, shown(semantic, clicked), int(semantic.max()) + 1, rules)
    seconds = time.perf_counter() - began
    coloured = np.nan
    if scene.cloud.colors is not None:
        said = nearest_label_in_place_and_colour(scene.cloud, clicked, semantic[clicked])
        coloured = unlabelled_miou(said, semantic, clicked)
    near = unlabelled_miou(nearest_label(scene.cloud.xyz, clicked, semantic[clicked]), semantic, clicked)
    return PropagationScores(near, coloured, unlabelled_miou(result.semantic, semantic, clicked), result, seconds)


def shown(semantic: Int[np.ndarray, ' points'], points: Int[np.ndarray, ' shown']) -> Int[np.ndarray, ' points']:
    """The classes of some points, -1 elsewhere."""
    annotated = np.full(len(semantic), UNLABELLED, dtype=np.int64)
    annotated[points] = semantic[points]
    return annotated


def draw_clicks(
    semantic: Int[np.ndarray, ' points'], budget: Budget, generator: np.random.Generator
) -> Int[np.ndarray, ' clicked']:
    """Points that are shown: one of each class; those and others by chance, twenty in all; at most twenty of each.

    Args:
        semantic: True class of each point, -1 = unknown.
        budget: Which.
        generator: Of the draw.
    """
    members = [np.flatnonzero(semantic == own) for own in np.unique(semantic[semantic >= 0])]
    if budget == 'twenty a class':
        return np.concatenate([generator.choice(each, min(TWENTY, len(each)), replace=False) for each in members])
    first = np.array([generator.choice(each) for each in members])
    if budget == 'one a class':
        return first
    others = generator.permutation(np.setdiff1d(np.flatnonzero(semantic >= 0), first))
    return np.concatenate([first, others])[:TWENTY]


def painted(
    xyz: Float[np.ndarray, 'points 3'],
    semantic: Int[np.ndarray, ' points'],
    clicked: Int[np.ndarray, ' clicked'],
    radius: float,
) -> Int[np.ndarray, ' painted']:
    """Points of strokes: those of the class of a click within some distance of it.

    Args:
        xyz: Metres.
        semantic: True class of each point, -1 = unknown.
        clicked: Points in the middle of the strokes.
        radius: Metres; 0: the clicks themselves.

    >>> row = np.array([[0.0, 0, 0], [0.4, 0, 0], [0.5, 0, 0], [3, 0, 0]])
    >>> painted(row, np.array([1, 1, 0, 1]), np.array([0]), 1.0)
    array([0, 1])
    """
    if not radius > 0:
        return clicked
    near = cKDTree(xyz).query_ball_point(xyz[clicked], radius)
    own = [np.array(rows)[semantic[rows] == semantic[click]] for rows, click in zip(near, clicked, strict=True)]
    return np.unique(np.concatenate([clicked, *own]))


def unlabelled_miou(
    said: Int[np.ndarray, ' points'], semantic: Int[np.ndarray, ' points'], clicked: Int[np.ndarray, ' clicked']
) -> float:
    """Mean IoU, percent, over the classes of the points whose class is known and was not shown.

    >>> unlabelled_miou(np.array([0, 0, 1, 1]), np.array([0, 0, 0, 1]), np.array([0]))
    50.0
    """
    asked = semantic >= 0
    asked[clicked] = False
    named, true = said[asked], semantic[asked]
    shares = [
        np.count_nonzero((named == own) & (true == own)) / np.count_nonzero((named == own) | (true == own))
        for own in np.unique(true)
    ]
    return 100.0 * float(np.mean(shares)) if shares else float('nan')
