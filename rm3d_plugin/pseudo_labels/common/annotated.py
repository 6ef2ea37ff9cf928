"""What a budget shows of a scene, for points and for regions."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.ops.segment import segment_majority, segment_values
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


class PointAnnotation(NamedTuple):
    """What annotated labels tell of each point.

    Attributes:
        semantic: (N,) int64 class, -1 = unknown.
        instance: (N,) int64 row of the boxes or instance number, -1 = none.
        seeds: (N,) int64 the classes that may propagate to the rest of a region: those not bounded by a box.
        shell: (N,) bool, just outside an annotated box.
    """

    semantic: Int[np.ndarray, ' points']
    instance: Int[np.ndarray, ' points']
    seeds: Int[np.ndarray, ' points']
    shell: Bool[np.ndarray, ' points']

    @property
    def known(self) -> Bool[np.ndarray, ' points']:
        """Points with a class."""
        return self.semantic >= 0

    def without(self, points: Bool[np.ndarray, ' points']) -> 'PointAnnotation':
        """The annotation of a segmentation scene as if these points had none."""
        semantic = np.where(points, UNLABELLED, self.semantic)
        return self._replace(semantic=semantic, instance=np.where(points, -1, self.instance), seeds=semantic)


def annotated_points(annotated: AnnotatedLabels) -> PointAnnotation:
    """Annotation of a segmentation scene: single points, which propagate to their regions."""
    shell = np.zeros(len(annotated), dtype=bool)
    return PointAnnotation(annotated.semantic, annotated.instance, annotated.semantic, shell)


def points_of_boxes(xyz: Float[np.ndarray, 'points 3'], annotated: AnnotatedLabels, background: int) -> PointAnnotation:
    """Annotation of a detection scene: an annotated box tells exactly which points are its object.

    So its class holds inside the box and does not propagate; what lies within 0.3 m around it is background. Where a
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
    return PointAnnotation(semantic, instance, seeds, around & (semantic < 0))


class RegionAnnotation(NamedTuple):
    """Annotated class and instance of each region, -1 where unknown."""

    labels: Int[np.ndarray, ' regions']
    instances: Int[np.ndarray, ' regions']


def annotated_regions(
    regions: Regions, points: PointAnnotation, class_counts: Int[np.ndarray, ' classes'], min_share: float
) -> RegionAnnotation:
    """Class and instance of the regions that hold annotated labels.

    Args:
        regions: Partition of the scene.
        points: What is annotated of the points.
        class_counts: How often each class is annotated in the whole training set.
        min_share: Share of a region's points that labels which do not propagate must cover to name the region; labels
            that do (seeds) name it however few they are.

    Returns:
        The most frequent class (tie: the more frequent in training, then the lowest; METHOD 1) and, among its points,
        the most frequent instance.
    """
    count = len(regions)
    covered = np.bincount(regions.labels[(regions.labels >= 0) & (points.semantic >= 0)], minlength=count)
    seeded = np.bincount(regions.labels[(regions.labels >= 0) & (points.seeds >= 0)], minlength=count) > 0
    named = seeded | ((covered > 0) & (covered >= min_share * regions.sizes))
    labels = np.where(named, segment_majority(points.semantic, regions.labels, count, class_counts), UNLABELLED)
    same = points.semantic == segment_values(labels, regions.labels, missing=-2)
    instances = segment_majority(np.where(same, points.instance, -1), regions.labels, count)
    return RegionAnnotation(labels, np.where(named, instances, -1))


class RegionClassPairs(NamedTuple):
    """Each region with each class of which it holds an annotated label, in ascending order.

    Attributes:
        regions: (S,) int64.
        classes: (S,) int64.
    """

    regions: Int[np.ndarray, ' pairs']
    classes: Int[np.ndarray, ' pairs']


def annotated_region_classes(
    region_labels: Int[np.ndarray, ' points'], annotated: Int[np.ndarray, ' points']
) -> RegionClassPairs:
    """Which classes the annotated labels of each region name."""
    seeds = (annotated >= 0) & (region_labels >= 0)
    pairs = np.unique(np.stack([region_labels[seeds], annotated[seeds]], axis=1), axis=0).astype(np.int64)
    return RegionClassPairs(pairs[:, 0], pairs[:, 1])


def usual_lengths(
    classes: Int[np.ndarray, ' pairs'], lengths: Float[np.ndarray, ' pairs'], count: int, least: int = 3
) -> Float[np.ndarray, ' classes']:
    """Median length of the regions in which labels of each class were annotated.

    Args:
        classes: Class of each seeded region, of all scenes.
        lengths: Its length, metres.
        count: Number of classes.
        least: Regions that a class needs.

    Returns:
        (C,) metres; NaN for a class of fewer regions.
    """
    return np.array([np.median(own) if len(own := lengths[classes == c]) >= least else np.nan for c in range(count)])
