"""Parts of a region that are of another class than the rest of it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.ops.segment import segment_values
from rm3d_plugin.pseudo_labels.common.groups import GroupLabels, pool_rows
from rm3d_plugin.structures import UNLABELLED


class PartLimits(NamedTuple):
    """What a part needs to be cut out.

    Attributes:
        gamma: Confidence of each of its points.
        share: Smallest share of its region; smaller: more and noisier parts.
        points: Fewest points.
    """

    gamma: float
    share: float
    points: int


def split_mixed(
    groups: GroupLabels,
    point_groups: Int[np.ndarray, ' points'],
    region_labels: Int[np.ndarray, ' points'],
    probabilities: Float[np.ndarray, 'points classes'],
    limits: PartLimits,
) -> tuple[GroupLabels, Int[np.ndarray, ' points']]:
    """Cut out of each region the points that the network is sure are of another class than the region's group.

    A region across two objects pools to a mean of which nobody is sure, and both would stay unlabelled. So rule (b) is
    asked again for the part of a region whose every point is confident and of one class.

    Args:
        groups: Labels of the groups.
        point_groups: Group of each point, -1 = none.
        region_labels: Region of each point, -1 = none.
        probabilities: (N, C) softmax; NaN or zero rows where the network saw nothing.
        limits: What a part needs.

    Returns:
        The groups with one more for each part, and the group of each point.
    """
    best = np.nan_to_num(probabilities).argmax(axis=1)
    sure = np.nan_to_num(probabilities[np.arange(len(best)), best]) >= limits.gamma
    closed = segment_values(groups.from_annotation, point_groups, True)  # annotated labels decided; or no region at all
    other = segment_values(groups.classes, point_groups, UNLABELLED) != best
    inside = np.flatnonzero(sure & other & ~closed.astype(bool))
    pairs, part, size = np.unique(
        np.stack([region_labels[inside], best[inside]], axis=1), axis=0, return_inverse=True, return_counts=True
    )
    whole = np.bincount(region_labels[region_labels >= 0], minlength=int(pairs[:, 0].max(initial=-1)) + 1)
    kept = (size >= limits.points) & (size >= limits.share * whole[pairs[:, 0]])
    number = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)[part.reshape(-1)]
    points, number = inside[number >= 0], number[number >= 0]
    count = int(kept.sum())
    own = np.zeros(len(best), dtype=np.int64)
    own[points] = number
    new_rows = pool_rows(probabilities, np.isin(np.arange(len(best)), points), own, count).values
    classes = pairs[kept, 1]
    extended = GroupLabels(
        np.concatenate([groups.classes, classes]),
        np.concatenate([groups.confidence, np.minimum(new_rows[np.arange(count), classes], 1.0)]),
        np.concatenate([groups.from_annotation, np.zeros(count, dtype=bool)]),
        np.concatenate([groups.probabilities, new_rows]),
    )
    out = point_groups.copy()
    out[points] = len(groups.classes) + number
    return extended, out
