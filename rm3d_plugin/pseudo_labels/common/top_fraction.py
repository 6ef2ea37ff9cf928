"""Class-balanced self-training: each round takes the surest part of every class (Zou et al., ECCV 2018).

One limit for all classes fills the labels with the easy classes first, and far points, which are unsure everywhere,
come last. A quota ranks the groups of one class (and one range of distance) among themselves instead.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.groups import GroupLabels
from rm3d_plugin.structures import UNLABELLED


def within_quota(
    groups: GroupLabels,
    point_groups: Int[np.ndarray, ' points'],
    share: float,
    ranges: Float[np.ndarray, ' points'] | None = None,
    range_edges: Sequence[float] = (),
) -> GroupLabels:
    """Take the class back from all but the most confident network-given groups of each class and range bin.

    Groups are taken by falling confidence (ties: the lower number) until they hold ``share`` of the bin's points; the
    one that reaches it is still taken, so every bin keeps its best. Groups named by true labels are out of the count.

    Args:
        groups: Labels of the groups.
        point_groups: Group of each point, -1 = none.
        share: In (0, 1]; 1 keeps all.
        ranges: Metres from the sensor to each point; needed with ``range_edges``.
        range_edges: Lower ends of the bins, metres; (): one bin.
    """
    given = np.flatnonzero(~groups.from_annotation & (groups.classes >= 0))
    if share >= 1 or len(given) == 0:
        return groups
    count, inside = len(groups.classes), point_groups >= 0
    sizes = np.bincount(point_groups[inside], minlength=count)
    bins = np.zeros(count, dtype=np.int64)
    if len(range_edges) and ranges is not None:
        mean = np.bincount(point_groups[inside], weights=ranges[inside], minlength=count) / np.maximum(sizes, 1)
        bins = np.maximum(np.searchsorted(np.asarray(range_edges), mean, side='right') - 1, 0)
    order = given[np.lexsort((given, -groups.confidence[given], bins[given], groups.classes[given]))]
    cell = groups.classes[order] * (len(range_edges) + 1) + bins[order]
    starts = np.flatnonzero(np.r_[True, cell[1:] != cell[:-1]])
    lengths = np.diff(np.append(starts, len(order)))
    before = np.cumsum(sizes[order]) - sizes[order]
    before -= np.repeat(before[starts], lengths)
    total = np.add.reduceat(sizes[order], starts)
    late = order[before >= share * np.repeat(total, lengths)]
    late = np.setdiff1d(late, order[starts])  # the best of a bin stays, even one without points
    classes, confidence = groups.classes.copy(), groups.confidence.copy()
    classes[late], confidence[late] = UNLABELLED, 0.0
    return groups._replace(classes=classes, confidence=confidence)
