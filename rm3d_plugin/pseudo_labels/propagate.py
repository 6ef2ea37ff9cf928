"""From groups of regions to labels of points (METHOD 1)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from rm3d_plugin.regions.strategy import Pooling
from rm3d_plugin.structures import UNLABELLED


class GroupLabels(NamedTuple):
    """What a group of regions is.

    Attributes:
        classes: (G,) int64; -1 = unlabelled.
        confidence: (G,) in [0, 1]: share of the majority among the true labels, else the mean softmax; 0 if unlabelled.
        from_truth: (G,) bool, True where true labels decided (rule a).
        probabilities: (G, C) size-weighted mean softmax; NaN where the network saw nothing of the group.
    """

    classes: Int[np.ndarray, ' groups']
    confidence: Float[np.ndarray, ' groups']
    from_truth: Bool[np.ndarray, ' groups']
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


def majority_of_votes(
    votes: Int[np.ndarray, 'groups classes'], class_counts: Int[np.ndarray, ' classes']
) -> tuple[Int[np.ndarray, ' groups'], Float[np.ndarray, ' groups']]:
    """Winner of each group and its share; see :func:`majority`."""
    count, classes = votes.shape
    # lexsort's last key counts most: votes, then training frequency, then the lower class.
    rank = np.empty(classes, dtype=np.int64)
    rank[np.lexsort((-np.arange(classes), class_counts))] = np.arange(classes)
    best = (votes * classes + rank).argmax(axis=1) if classes else np.zeros(count, dtype=np.int64)
    total = votes.sum(axis=1)
    share = (votes[np.arange(count), best] if classes else total) / np.maximum(total, 1)
    return np.where(total > 0, best, UNLABELLED).astype(np.int64), np.where(total > 0, share, 0.0)


def majority(
    labels: Int[np.ndarray, ' points'],
    groups: Int[np.ndarray, ' points'],
    count: int,
    class_counts: Int[np.ndarray, ' classes'],
) -> tuple[Int[np.ndarray, ' groups'], Float[np.ndarray, ' groups']]:
    """Most frequent label of each group and its share; tie: the class more frequent in training, then the lower one.

    Args:
        labels: Class of each point, -1 = no vote.
        groups: Group of each point, -1 = none.
        count: Number of groups.
        class_counts: How often each class occurs among the revealed training labels.

    Returns:
        (G,) int64 class, -1 where nobody voted, and (G,) share of the votes, 0 where nobody voted.
    """
    return majority_of_votes(count_votes(labels, groups, count, len(class_counts)), class_counts)


def label_groups(
    group: Int[np.ndarray, ' regions'],
    pooled: Pooled,
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    class_counts: Int[np.ndarray, ' classes'],
    gamma: float,
) -> GroupLabels:
    """Rule (a) majority of true labels, (b) confident mean prediction, (c) nothing (METHOD 1).

    Args:
        group: Group of each region.
        pooled: Pooled softmax of each region.
        region_labels: Region of each point.
        true_labels: True class of each point, -1 where unknown.
        class_counts: How often each class occurs among the revealed training labels; breaks ties.
        gamma: Rule (b)'s limit.
    """
    votes = count_votes(true_labels, region_labels, len(group), len(class_counts))
    return label_groups_by_votes(group, pooled, votes, class_counts, gamma)


def label_groups_by_votes(
    group: Int[np.ndarray, ' regions'],
    pooled: Pooled,
    votes: Int[np.ndarray, 'regions classes'],
    class_counts: Int[np.ndarray, ' classes'],
    gamma: float,
) -> GroupLabels:
    """:func:`label_groups` with the true labels counted by region already.

    Args:
        group: Group of each region.
        pooled: Pooled softmax of each region.
        votes: True labels of each region by class.
        class_counts: Breaks ties.
        gamma: Rule (b)'s limit.
    """
    count = int(group.max(initial=-1)) + 1
    summed = np.zeros((count, votes.shape[1]), dtype=np.int64)
    np.add.at(summed, group, votes)
    voted, share = majority_of_votes(summed, class_counts)
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
    doubtful = ~groups.from_truth & (groups.confidence < limit)
    return groups._replace(
        classes=np.where(doubtful, UNLABELLED, groups.classes), confidence=np.where(doubtful, 0.0, groups.confidence)
    )


def split_mixed(
    groups: GroupLabels,
    point_groups: Int[np.ndarray, ' points'],
    region_labels: Int[np.ndarray, ' points'],
    probabilities: Float[np.ndarray, 'points classes'],
    gamma: float,
    min_share: float,
    min_points: int,
) -> tuple[GroupLabels, Int[np.ndarray, ' points']]:
    """Cut out of each region the points that the network is sure are of another class than the region's group.

    A region across two objects pools to a mean of which nobody is sure, and both would stay unlabelled. So rule (b) is
    asked again for the part of a region whose every point is confident and of one class.

    Args:
        groups: Labels of the groups.
        point_groups: Group of each point, -1 = none.
        region_labels: Region of each point, -1 = none.
        probabilities: (N, C) softmax; NaN or zero rows where the network saw nothing.
        gamma: Confidence that each of these points needs.
        min_share: Smallest share of a region's points that is cut out; smaller: more and noisier parts.
        min_points: Fewest points of a part.

    Returns:
        The groups with one more for each part, and the group of each point.
    """
    best = np.nan_to_num(probabilities).argmax(axis=1)
    sure = np.nan_to_num(probabilities[np.arange(len(best)), best]) >= gamma
    closed = point_values(groups.from_truth, point_groups, True)  # true labels decided; or no region at all
    other = point_values(groups.classes, point_groups, UNLABELLED) != best
    inside = np.flatnonzero(sure & other & ~closed.astype(bool))
    pairs, part, size = np.unique(
        np.stack([region_labels[inside], best[inside]], axis=1), axis=0, return_inverse=True, return_counts=True
    )
    whole = np.bincount(region_labels[region_labels >= 0], minlength=int(pairs[:, 0].max(initial=-1)) + 1)
    kept = (size >= min_points) & (size >= min_share * whole[pairs[:, 0]])
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
        np.concatenate([groups.from_truth, np.zeros(count, dtype=bool)]),
        np.concatenate([groups.probabilities, new_rows]),
    )
    out = point_groups.copy()
    out[points] = len(groups.classes) + number
    return extended, out


def point_values(values: np.ndarray, labels: Int[np.ndarray, ' points'], missing: float) -> np.ndarray:
    """The value of each point's region (or group); ``missing`` for points of none."""
    return np.append(values, np.array([missing], dtype=values.dtype))[labels]


def nearest_instances(
    xyz: Float[np.ndarray, 'points 3'],
    point_groups: Int[np.ndarray, ' points'],
    point_classes: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    true_instances: Int[np.ndarray, ' points'],
) -> Int[np.ndarray, ' points']:
    """Instance of the nearest labelled seed of the same group and class; -1 where there is none.

    Args:
        xyz: Points, metres.
        point_groups: Group of each point, -1 = none.
        point_classes: Class given to each point.
        true_labels: True class of each point, -1 where unknown.
        true_instances: True instance of each point, -1 where unknown.
    """
    out = np.full(len(xyz), -1, dtype=np.int64)
    seeds = np.flatnonzero((true_instances >= 0) & (true_labels >= 0) & (point_groups >= 0))
    for g in np.unique(point_groups[seeds]):
        members = np.flatnonzero(point_groups == g)
        own = seeds[point_groups[seeds] == g]
        for c in np.unique(true_labels[own]):
            sources = own[true_labels[own] == c]
            targets = members[point_classes[members] == c]
            if len(targets):
                _, nearest = cKDTree(xyz[sources]).query(xyz[targets])
                out[targets] = true_instances[sources[nearest]]
    return out


def mixed_regions(
    region_labels: Int[np.ndarray, ' points'], true_labels: Int[np.ndarray, ' points']
) -> Int[np.ndarray, ' mixed']:
    """Regions that hold true labels of several classes, ascending."""
    regions, classes = np.unique(seeded_regions(region_labels, true_labels).regions, return_counts=True)
    return np.asarray(regions[classes > 1], dtype=np.int64)


def nearest_seeds(
    xyz: Float[np.ndarray, 'points 3'],
    colors: Float[np.ndarray, 'points 3'] | None,
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    place: float,
    color: float,
    regions: Int[np.ndarray, ' asked'] | None = None,
) -> Int[np.ndarray, ' points']:
    """The labelled point of its own region that is nearest to each point and alike.

    The distance is that of (xyz / place, colour / color).

    Args:
        xyz: Metres.
        colors: RGB in [0, 1], or None: the place alone.
        region_labels: Region of each point, -1 = none.
        true_labels: True class of each point, -1 = unknown.
        place: Metres that count as much as ``color``.
        color: Difference of colour that counts 1; larger: place decides.
        regions: Only these regions, which all hold a true label; None: all that do.

    Returns:
        (N,) int64; -1 for points of other regions.
    """
    out = np.full(len(xyz), -1, dtype=np.int64)
    where = xyz / place if colors is None else np.concatenate([xyz / place, colors / color], axis=1)
    if regions is None:
        regions = np.unique(region_labels[(true_labels >= 0) & (region_labels >= 0)])
    order = np.argsort(region_labels, kind='stable')
    bounds = np.searchsorted(region_labels[order], np.stack([regions, regions + 1], axis=1).reshape(-1))
    for first, last in bounds.reshape(-1, 2).tolist():
        members = order[first:last]
        own = members[true_labels[members] >= 0]
        _, nearest = cKDTree(where[own]).query(where[members])
        out[members] = own[nearest]
    return out


def nearest_true_classes(
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    seeds: Int[np.ndarray, ' points'],
) -> Int[np.ndarray, ' points']:
    """In regions that hold true labels of several classes: the class of the labelled point that is nearest and alike.

    A majority would give the window in a wall to the wall.

    Args:
        region_labels: Region of each point, -1 = none.
        true_labels: True class of each point, -1 = unknown.
        seeds: Labelled point for each point, see :func:`nearest_seeds`.

    Returns:
        (N,) int64; -1 for points of regions whose true labels agree, or that hold none.
    """
    mixed = np.isin(region_labels, mixed_regions(region_labels, true_labels))
    return np.where(mixed, np.append(true_labels, UNLABELLED)[seeds], UNLABELLED).astype(np.int64)


def of_present_classes(
    probabilities: Float[np.ndarray, 'points classes'], true_labels: Int[np.ndarray, ' points']
) -> Float[np.ndarray, 'points classes']:
    """The softmax over those classes alone of which the scene holds a true label; unchanged where it holds none.

    Rows of which nothing is left (or that the network did not see) become NaN.
    """
    present = np.zeros(probabilities.shape[1], dtype=bool)
    present[true_labels[true_labels >= 0]] = True
    if not present.any():
        return probabilities
    kept = np.where(present, probabilities, 0.0)
    total = kept.sum(axis=1, keepdims=True)
    return np.where(total > 0, kept / np.where(total > 0, total, 1.0), np.nan)


class SeededRegions(NamedTuple):
    """Each region with each class of which it holds a true label, in ascending order.

    Attributes:
        regions: (S,) int64.
        classes: (S,) int64.
    """

    regions: Int[np.ndarray, ' pairs']
    classes: Int[np.ndarray, ' pairs']


def seeded_regions(region_labels: Int[np.ndarray, ' points'], true_labels: Int[np.ndarray, ' points']) -> SeededRegions:
    """Which classes the true labels of each region name."""
    seeds = (true_labels >= 0) & (region_labels >= 0)
    pairs = np.unique(np.stack([region_labels[seeds], true_labels[seeds]], axis=1), axis=0).astype(np.int64)
    return SeededRegions(pairs[:, 0], pairs[:, 1])


def usual_lengths(
    classes: Int[np.ndarray, ' pairs'], lengths: Float[np.ndarray, ' pairs'], count: int, least: int = 3
) -> Float[np.ndarray, ' classes']:
    """Median length of the regions in which labels of each class were revealed.

    Args:
        classes: Class of each seeded region, of all scenes.
        lengths: Its length, metres.
        count: Number of classes.
        least: Regions that a class needs.

    Returns:
        (C,) metres; NaN for a class of fewer regions.
    """
    return np.array([np.median(own) if len(own := lengths[classes == c]) >= least else np.nan for c in range(count)])


def quiet_seeds(
    region_labels: Int[np.ndarray, ' points'],
    true_labels: Int[np.ndarray, ' points'],
    lengths: Float[np.ndarray, ' regions'],
    usual: Float[np.ndarray, ' classes'],
    factor: float,
) -> Bool[np.ndarray, ' points']:
    """True labels in a region that is far too long for their class: the picture's point that fell upon the wall.

    Args:
        region_labels: Region of each point, -1 = none.
        true_labels: True class of each point, -1 = unknown.
        lengths: Of each region, metres.
        usual: Usual length for each class, see :func:`usual_lengths`; NaN: never too long.
        factor: Lengths above this many usual ones are too long.
    """
    inside = (true_labels >= 0) & (region_labels >= 0)
    limit = np.append(usual, np.nan)[true_labels] * factor
    return np.asarray(inside & (np.append(lengths, 0.0)[region_labels] > limit))


def unlike_seed(
    colors: Float[np.ndarray, 'points 3'], seeds: Int[np.ndarray, ' points'], limit: float
) -> Bool[np.ndarray, ' points']:
    """Points that differ in colour from their labelled point (see :func:`nearest_seeds`) by more than the limit."""
    return np.asarray((seeds >= 0) & (np.linalg.norm(colors - colors[seeds], axis=1) > limit))


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
    found = point_values(classes.astype(np.int64), inside, UNLABELLED)
    return found, np.where(found >= 0, point_values(peak, inside, 0.0), 0.0)
