"""From groups of regions to labels of points (METHOD 1)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from rm3d_plugin.ops.segment import majority_of_counts, segment_values
from rm3d_plugin.regions.rules import Pooling
from rm3d_plugin.structures import UNLABELLED


class GroupLabels(NamedTuple):
    """What a group of regions is.

    Attributes:
        classes: (G,) int64; -1 = unlabelled.
        confidence: (G,) in [0, 1]: share of the majority among the annotated labels, else the mean softmax; 0 if
            unlabelled.
        from_annotation: (G,) bool, True where annotated labels decided (rule a).
        probabilities: (G, C) size-weighted mean softmax; NaN where the network saw nothing of the group.
    """

    classes: Int[np.ndarray, ' groups']
    confidence: Float[np.ndarray, ' groups']
    from_annotation: Bool[np.ndarray, ' groups']
    probabilities: Float[np.ndarray, 'groups classes']


class Pooled(NamedTuple):
    """Rows pooled over regions.

    Attributes:
        values: (R, C) float64; NaN where no point of the region was seen.
        seen: (R,) int64 points that took part.
    """

    values: Float[np.ndarray, 'regions channels']
    seen: Int[np.ndarray, ' regions']


def seen_rows(probabilities: Float[np.ndarray, 'points classes']) -> Bool[np.ndarray, ' points']:
    """Points that the network saw: their row is finite and not all zero."""
    return np.asarray(np.isfinite(probabilities).all(axis=1) & (probabilities > 0).any(axis=1))


def likely_classes(probabilities: Float[np.ndarray, 'points classes']) -> Int[np.ndarray, ' points']:
    """Most probable class of each point, -1 where the network saw none."""
    return np.where(seen_rows(probabilities), np.nan_to_num(probabilities).argmax(axis=1), -1)


def pool_rows(
    values: Float[np.ndarray, 'points channels'],
    seen: Bool[np.ndarray, ' points'],
    labels: Int[np.ndarray, ' points'],
    count: int,
    pooling: Pooling = 'mean',
) -> Pooled:
    """Mean (or maximum, renormalised) of the seen points' rows over each region or group.

    Args:
        values: One row a point.
        seen: Which rows count.
        labels: Region of each point; -1 counts nowhere.
        count: Number of regions.
        pooling: 'max' suits probabilities only: its rows are divided by their sum.
    """
    used = seen & (labels >= 0)
    where, rows = labels[used], values[used].astype(np.float64)
    number = np.bincount(where, minlength=count)
    if pooling == 'max':
        pooled = np.full((count, values.shape[1]), -np.inf)
        np.maximum.at(pooled, where, rows)
        pooled = np.where(number[:, None] > 0, pooled, 1.0)
        pooled /= pooled.sum(axis=1, keepdims=True)
    else:
        members = csr_array((np.ones(len(where)), (where, np.arange(len(where)))), shape=(count, len(where)))
        pooled = members @ rows / np.maximum(number, 1)[:, None]
    pooled[number == 0] = np.nan
    return Pooled(pooled, number)


def count_votes(
    labels: Int[np.ndarray, ' points'], groups: Int[np.ndarray, ' points'], count: int, classes: int
) -> Int[np.ndarray, 'groups classes']:
    """How often each class occurs in each group (or region); -1 votes for nothing and belongs nowhere."""
    used = (labels >= 0) & (groups >= 0)
    votes = np.bincount(groups[used] * classes + labels[used], minlength=count * classes)
    return votes.reshape(count, classes)


def label_groups(
    group: Int[np.ndarray, ' regions'],
    pooled: Pooled,
    votes: Int[np.ndarray, 'regions classes'],
    class_counts: Int[np.ndarray, ' classes'],
    gamma: float,
) -> GroupLabels:
    """Rule (a) majority of annotated labels, (b) confident mean prediction, (c) nothing (METHOD 1).

    Args:
        group: Group of each region.
        pooled: Pooled softmax of each region.
        votes: Annotated labels of each region by class.
        class_counts: Breaks ties.
        gamma: Rule (b)'s limit.
    """
    count = int(group.max(initial=-1)) + 1
    summed = np.zeros((count, votes.shape[1]), dtype=np.int64)
    np.add.at(summed, group, votes)
    voted, share = majority_of_counts(summed, class_counts)
    weights = pooled.seen.astype(np.float64)
    total = np.bincount(group, weights=weights, minlength=count)
    filled = np.nan_to_num(pooled.values) * weights[:, None]
    sums = [np.bincount(group, weights=column, minlength=count) for column in filled.T]
    mean = np.stack(sums, axis=1) if sums else np.zeros((count, 0))
    mean = np.where(total[:, None] > 0, mean / np.maximum(total, 1)[:, None], np.nan)
    filled = np.nan_to_num(mean)
    peak = filled.max(axis=1, initial=0.0)
    predicted = filled.argmax(axis=1) if mean.shape[1] else np.zeros(count, dtype=np.int64)
    confident = (total > 0) & (peak >= gamma)
    known = voted >= 0
    classes = np.where(known, voted, np.where(confident, predicted, UNLABELLED))
    confidence = np.where(known, share, np.where(confident, np.minimum(peak, 1.0), 0.0))
    return GroupLabels(classes.astype(np.int64), confidence, known, mean)


def without_doubtful(groups: GroupLabels, class_gamma: Float[np.ndarray, ' classes']) -> GroupLabels:
    """Take the class back from the groups that the network gave it with less confidence than that class asks for."""
    limit = np.append(class_gamma, 0.0)[groups.classes]  # -1, no class, meets the limit 0
    doubtful = ~groups.from_annotation & (groups.confidence < limit)
    return groups._replace(
        classes=np.where(doubtful, UNLABELLED, groups.classes), confidence=np.where(doubtful, 0.0, groups.confidence)
    )


def nearest_instances(
    xyz: Float[np.ndarray, 'points 3'],
    point_groups: Int[np.ndarray, ' points'],
    point_classes: Int[np.ndarray, ' points'],
    annotated: Int[np.ndarray, ' points'],
    annotated_instances: Int[np.ndarray, ' points'],
) -> Int[np.ndarray, ' points']:
    """Instance of the nearest labelled seed of the same group and class; -1 where there is none.

    Args:
        xyz: Points, metres.
        point_groups: Group of each point, -1 = none.
        point_classes: Class given to each point.
        annotated: Annotated class of each point, -1 = none.
        annotated_instances: Annotated instance of each point, -1 = none.
    """
    out = np.full(len(xyz), -1, dtype=np.int64)
    seeds = np.flatnonzero((annotated_instances >= 0) & (annotated >= 0) & (point_groups >= 0))
    for g in np.unique(point_groups[seeds]):
        members = np.flatnonzero(point_groups == g)
        own = seeds[point_groups[seeds] == g]
        for c in np.unique(annotated[own]):
            sources = own[annotated[own] == c]
            targets = members[point_classes[members] == c]
            if len(targets):
                _, nearest = cKDTree(xyz[sources]).query(xyz[targets])
                out[targets] = annotated_instances[sources[nearest]]
    return out


def confident_parts(
    probabilities: Float[np.ndarray, 'points classes'],
    region_labels: Int[np.ndarray, ' points'],
    part: Bool[np.ndarray, ' points'],
    gamma: float,
) -> tuple[Int[np.ndarray, ' points'], Float[np.ndarray, ' points']]:
    """Rule (b) for a part of each region: the class that the network gives it with confidence.

    Args:
        probabilities: (N, C) softmax; NaN or zero rows where the network saw nothing.
        region_labels: Region of each point, -1 = none.
        part: Points that count.
        gamma: Mean softmax over the part of a region that its class needs.

    Returns:
        (N,) class, -1 where no class is confident and outside the part, and (N,) confidence, 0 there.
    """
    count = int(region_labels.max(initial=-1)) + 1
    pooled = pool_rows(probabilities, seen_rows(probabilities) & part, region_labels, count).values
    peak = np.nan_to_num(pooled).max(axis=1, initial=0.0)
    classes = np.where(peak >= gamma, np.nan_to_num(pooled).argmax(axis=1) if pooled.size else 0, UNLABELLED)
    inside = np.where(part, region_labels, -1)
    found = segment_values(classes.astype(np.int64), inside, UNLABELLED)
    return found, np.where(found >= 0, segment_values(peak, inside, 0.0), 0.0)
