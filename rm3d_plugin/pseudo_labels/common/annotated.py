"""What a budget shows of a scene, for points and for regions."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.structures import UNLABELLED, Boxes3D, Regions

BOX_SHELL = 0.3  # m; what is this near an annotated box but not in it is background


@dataclass(frozen=True, eq=False)
class AnnotatedLabels:
    """The annotated labels of one scene.

    Attributes:
        semantic: (N,) int64 class of each point, -1 = not annotated.
        instance: (N,) int64 row of ``boxes`` (detection) or instance number, -1 = not annotated.
        boxes: Annotated boxes.
        complete: True where every label of the scene is annotated.

    Raises:
        ValueError: The two label rows differ in length, or in detection an instance names no box.
    """

    semantic: Int[np.ndarray, ' points']
    instance: Int[np.ndarray, ' points']
    boxes: Boxes3D
    complete: bool = False

    def __post_init__(self) -> None:
        if len(self.semantic) != len(self.instance):
            raise ValueError(
                f'AnnotatedLabels.instance: expected {len(self.semantic)} rows (as semantic), got {len(self.instance)}'
            )
        if len(self.boxes) and len(self.instance) and self.instance.max() >= len(self.boxes):
            raise ValueError(
                f'AnnotatedLabels.instance: names box {self.instance.max()}, but {len(self.boxes)} boxes are annotated'
            )

    @classmethod
    def nothing(cls, points: int) -> 'AnnotatedLabels':
        """A scene of which nothing is annotated."""
        unknown = np.full(points, UNLABELLED, dtype=np.int64)
        return cls(unknown, unknown.copy(), Boxes3D.empty())

    def __len__(self) -> int:
        return len(self.semantic)


class Truth(NamedTuple):
    """What is surely known of each point.

    Attributes:
        semantic: (N,) int64 class, -1 = unknown.
        instance: (N,) int64 row of the boxes or instance number, -1 = none.
        seeds: (N,) int64 the classes that may spread to the rest of a region: those not bounded by a box.
        shell: (N,) bool, just outside an annotated box.
    """

    semantic: Int[np.ndarray, ' points']
    instance: Int[np.ndarray, ' points']
    seeds: Int[np.ndarray, ' points']
    shell: Bool[np.ndarray, ' points']


def known_points(annotated: AnnotatedLabels) -> Truth:
    """Truth of a segmentation scene: annotated points, which spread to their regions."""
    shell = np.zeros(len(annotated), dtype=bool)
    return Truth(annotated.semantic, annotated.instance, annotated.semantic, shell)


def known_by_boxes(xyz: Float[np.ndarray, 'points 3'], annotated: AnnotatedLabels, background: int) -> Truth:
    """Truth of a detection scene: an annotated box tells exactly which points are its object.

    So its class holds inside the box and does not spread; what lies within 0.3 m around it is background. Where a
    scene is complete, all that is in no box is background.

    Args:
        xyz: Points, metres.
        annotated: Annotated labels.
        background: Class number of background.
    """
    inside = points_in_boxes(xyz, annotated.boxes.tensor)
    instance = np.where(annotated.instance >= 0, annotated.instance, inside)
    by_box = np.append(annotated.boxes.labels, UNLABELLED)[instance]
    semantic = np.where(annotated.semantic >= 0, annotated.semantic, by_box)
    if annotated.complete:
        semantic = np.where(semantic >= 0, semantic, background)
    seeds = np.where(instance < 0, annotated.semantic, UNLABELLED)
    around = points_in_boxes(xyz, annotated.boxes.tensor, margin=BOX_SHELL) >= 0
    return Truth(semantic, instance, seeds, around & (semantic < 0))


class RegionTruth(NamedTuple):
    """True class and instance of each region, -1 where unknown."""

    labels: Int[np.ndarray, ' regions']
    instances: Int[np.ndarray, ' regions']


def known_regions(regions: Regions, truth: Truth, min_share: float) -> RegionTruth:
    """Class and instance of the regions that hold true labels.

    Args:
        regions: Partition of the scene.
        truth: What is known of the points.
        min_share: Share of a region's points that labels which do not spread must cover to name the region; labels
            that spread (seeds) name it however few they are.

    Returns:
        The most frequent class (tie: the lowest) and, among its points, the most frequent instance.
    """
    count = len(regions)
    covered = np.bincount(regions.labels[(regions.labels >= 0) & (truth.semantic >= 0)], minlength=count)
    seeded = np.bincount(regions.labels[(regions.labels >= 0) & (truth.seeds >= 0)], minlength=count) > 0
    named = seeded | ((covered > 0) & (covered >= min_share * regions.sizes))
    labels = np.where(named, _mode(regions.labels, truth.semantic, count), UNLABELLED)
    same = truth.semantic == np.append(labels, -2)[regions.labels]
    instances = _mode(regions.labels, np.where(same, truth.instance, -1), count)
    return RegionTruth(labels, np.where(named, instances, -1))


def _mode(
    groups: Int[np.ndarray, ' points'], values: Int[np.ndarray, ' points'], count: int
) -> Int[np.ndarray, ' groups']:
    """Most frequent value >= 0 of each group, lowest on a tie; -1 where there is none."""
    out = np.full(count, -1, dtype=np.int64)
    used = (groups >= 0) & (values >= 0)
    if used.any():
        pairs, votes = np.unique(np.stack([groups[used], values[used]], axis=1), axis=0, return_counts=True)
        order = np.lexsort((pairs[:, 1], -votes, pairs[:, 0]))
        _, first = np.unique(pairs[order, 0], return_index=True)
        winners = pairs[order[first]]
        out[winners[:, 0]] = winners[:, 1]
    return out
