"""Class-balanced self-training: each round takes the most confident part of every class (Zou et al., ECCV 2018).

One limit for all classes fills the labels with the easy classes first, and far points, which are unsure everywhere,
come last. A fraction ranks the groups of one class (and one range of distance) among themselves instead.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.groups import GroupLabels
from rm3d_plugin.structures import UNLABELLED
from rm3d_plugin.structures.check_field import check_field


@dataclass(frozen=True)
class SelfTrainingRules:
    """How a round's new labels are limited and checked. The defaults limit and check nothing.

    Attributes:
        cbst_fraction: In the first round with predictions each scene takes, class by class, only its most confident
            network-given groups, up to this share of their points; the share grows by round to 1. Smaller: slower and
            purer. None: every confident group at once.
        cbst_ranges: Lower ends of range bins, metres from the sensor, each with a share of its own; (): one bin.
        holdout: Share of the annotated points of a scene that is kept aside to check the labels of each round, and
            neither trained on nor used for merging; 0: no check. Segmentation only.
        holdout_margin: A round's new labels are dropped where the share of holdout points that they contradict exceeds
            the former round's by more than this; larger: fewer rounds are rolled back.
    """

    cbst_fraction: float | None = None
    cbst_ranges: tuple[float, ...] = ()
    holdout: float = 0.0
    holdout_margin: float = 0.05

    def __post_init__(self) -> None:
        object.__setattr__(self, 'cbst_ranges', tuple(self.cbst_ranges))
        fraction, ranges = self.cbst_fraction, self.cbst_ranges
        check_field(self, 'cbst_fraction', fraction is None or 0 < fraction <= 1, 'a share in (0, 1], or None')
        rising = all(a < b for a, b in zip(ranges, ranges[1:], strict=False))
        check_field(self, 'cbst_ranges', rising and all(r >= 0 for r in ranges), 'rising metres >= 0')
        check_field(self, 'holdout', 0 <= self.holdout < 1, 'a share in [0, 1)')
        check_field(self, 'holdout_margin', 0 <= self.holdout_margin <= 1, 'a share in [0, 1]')

    def fraction(self, round: int, rounds: int) -> float:
        """Share of the network-given points that a round may take: ``cbst_fraction`` in round 1, 1 in the last refresh.

        Args:
            round: 0 .. rounds.
            rounds: Of the schedule.
        """
        if self.cbst_fraction is None:
            return 1.0
        steps = max(rounds - 2, 1)  # refreshes after the first; the last has the number rounds - 1
        return self.cbst_fraction + (1.0 - self.cbst_fraction) * min(max((round - 1) / steps, 0.0), 1.0)


def most_confident_groups(
    groups: GroupLabels,
    point_groups: Int[np.ndarray, ' points'],
    share: float,
    ranges: Float[np.ndarray, ' points'] | None = None,
    range_edges: tuple[float, ...] = (),
) -> GroupLabels:
    """Take the class back from all but the most confident network-given groups of each class and range bin.

    Groups are taken by falling confidence (ties: the lower number) until they hold ``share`` of the bin's points; the
    one that reaches it is still taken, so every bin keeps its best. Groups named by annotated labels do not count.

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
    sizes = np.bincount(point_groups[point_groups >= 0], minlength=len(groups.classes))
    bins = _range_bins(point_groups, sizes, ranges, range_edges)
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


def _range_bins(
    point_groups: Int[np.ndarray, ' points'],
    sizes: Int[np.ndarray, ' groups'],
    ranges: Float[np.ndarray, ' points'] | None,
    edges: tuple[float, ...],
) -> Int[np.ndarray, ' groups']:
    """Bin of each group by the mean range of its points."""
    if not edges or ranges is None:
        return np.zeros(len(sizes), dtype=np.int64)
    inside = point_groups >= 0
    mean = np.bincount(point_groups[inside], weights=ranges[inside], minlength=len(sizes)) / np.maximum(sizes, 1)
    return np.asarray(np.maximum(np.searchsorted(np.asarray(edges), mean, side='right') - 1, 0))
