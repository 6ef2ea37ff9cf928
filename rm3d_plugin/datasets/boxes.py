"""What data sets with boxes share: the range, one strength a point, truth of the points from the boxes."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rm3d_plugin.datasets.base import SceneDataset, Truth
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError

BRIGHTEST = 0.98  # quantile of a scan's own strengths that reads as 1: a few mirrors do not darken the rest


def within(
    rows: Float[np.ndarray, 'rows columns'], limits: Float[np.ndarray, '6'], axes: int
) -> Bool[np.ndarray, ' rows']:
    """True where the first ``axes`` coordinates lie in [least, greatest); by columns, since short rows are slow."""
    inside = np.ones(len(rows), dtype=bool)
    for axis in range(axes):
        inside &= (rows[:, axis] >= limits[axis]) & (rows[:, axis] < limits[axis + 3])
    return inside


def with_strength(cloud: PointCloud, intensity_range: float | None = None) -> PointCloud:
    """The cloud with one return strength a point in [0, 1], which is what a detector reads beside the place.

    Args:
        cloud: Points of any sensor.
        intensity_range: Strength that reads as 1; None: what :data:`BRIGHTEST` of the scan's own points do not exceed,
            so that sensors of any scale look alike (where strengths are negative, 0 is as dark as their darkest 2 %).
            Where there is no intensity the strength is the mean of the colours, and without these 0.
    """
    if cloud.intensity is None:
        grey = np.zeros(len(cloud)) if cloud.colors is None else cloud.colors.mean(axis=1)
        return replace(cloud, intensity=grey)
    strength = np.nan_to_num(cloud.intensity.astype(np.float64), posinf=0.0, neginf=0.0)
    low, top = 0.0, intensity_range
    if top is None:
        darkest, brightest = np.quantile(strength, (1 - BRIGHTEST, BRIGHTEST)) if len(strength) else (0.0, 0.0)
        low, top = min(0.0, float(darkest)), float(brightest)
    return replace(cloud, intensity=np.clip((strength - low) / (top - low), 0.0, 1.0) if top > low else 0.0 * strength)


def in_units(cloud: PointCloud, unit: float) -> PointCloud:
    """The cloud with ``unit`` metres as one; world = xyz * unit + origin."""
    if unit == 1:
        return cloud
    return replace(
        cloud, xyz=cloud.xyz / unit, sensor=None if cloud.sensor is None else np.asarray(cloud.sensor) / unit
    )


def to_units(boxes: Boxes3D, origin: Float[np.ndarray, '3'], unit: float) -> Boxes3D:
    """World boxes in the frame of a cloud in units."""
    scale = np.r_[np.full(6, 1 / unit), 1.0]
    return Boxes3D((boxes.tensor - np.pad(origin, (0, 4))) * scale, boxes.labels, boxes.scores)


def to_world(boxes: Boxes3D, origin: Float[np.ndarray, '3'], unit: float) -> Boxes3D:
    """Undo :func:`to_units`."""
    scale = np.r_[np.full(6, unit), 1.0]
    return Boxes3D(boxes.tensor * scale + np.pad(origin, (0, 4)), boxes.labels, boxes.scores)


class BoxDataset(SceneDataset):
    """Scenes whose objects have boxes; what a subclass reads is cropped here and becomes truth here.

    Args:
        split: 'train' refuses labels='truth': training reads labels through the store.
        point_range: (x, y, z, x, y, z) metres, least then greatest; points outside are dropped, and boxes whose centre
            lies outside in x or y. None: everything stays.
        intensity_range: See :func:`with_strength`.
        base: Arguments of :class:`SceneDataset`.

    Raises:
        ValueError: A choice that there is not.
    """

    def __init__(
        self,
        split: str,
        point_range: Sequence[float] | None = None,
        intensity_range: float | None = None,
        **base: Any,
    ) -> None:
        super().__init__(**base)
        if self.labels == 'truth' and split == 'train':
            raise ValueError(
                "labels='truth' is for splits that metrics are measured on, got split 'train'; "
                "training reads labels='store', prediction needs labels='none'"
            )
        if intensity_range is not None and not intensity_range > 0:
            raise ValueError(f'intensity_range: expected a number > 0, got {intensity_range}')
        self.split = split
        self.point_range = None if point_range is None else checked_range(point_range)
        self.intensity_range = intensity_range

    @abstractmethod
    def read_cloud(self, index: int) -> PointCloud:
        """Every point of a scene.

        Raises:
            SceneError: The scene cannot be used.
        """

    @abstractmethod
    def read_boxes(self, index: int, cloud: PointCloud) -> Boxes3D:
        """Every box of a scene of the data set's classes, in the frame of its ``cloud``.

        Raises:
            SceneError: There are none to read, or they cannot be used.
        """

    def load_cloud(self, index: int) -> PointCloud:
        """Points in range, each with one strength."""
        cloud = self.read_cloud(index)
        if self.point_range is not None:
            kept = within(cloud.xyz, self.point_range, axes=3)
            if not kept.any():
                raise SceneError(
                    f'scene {self.scene_ids[index]}: none of its {len(cloud)} points lies in point_range '
                    f'{self.point_range.tolist()}; widen it'
                )
            cloud = cloud.select(kept)
        return with_strength(cloud, self.intensity_range)

    def load_truth(self, index: int) -> Truth:
        """Boxes in range; points inside them, background elsewhere."""
        cloud = self.load_cloud(index)
        boxes = self.read_boxes(index, cloud)
        if self.point_range is not None:
            boxes = boxes.select(within(boxes.tensor, self.point_range, axes=2))
        instance = points_in_boxes(cloud.xyz, boxes.tensor)
        semantic = np.full(len(cloud), len(self.classes), dtype=np.int64)
        semantic[instance >= 0] = boxes.labels[instance[instance >= 0]]
        return Truth(boxes, semantic, instance)

    def check_scene(self, index: int) -> None:
        """Read the points, and the boxes where there are any.

        Raises:
            SceneError: The scene cannot be used.
        """
        if self.labels == 'truth' or self.is_labelled(index):
            self.load_truth(index)  # reads the points, too
        else:
            self.load_cloud(index)


def checked_range(point_range: Sequence[float]) -> Float[np.ndarray, '6']:
    """The range as an array.

    Raises:
        ValueError: It is not (x, y, z, x, y, z), least then greatest.
    """
    limits = np.asarray(point_range, dtype=np.float64)
    if limits.shape != (6,) or not (limits[:3] < limits[3:]).all():
        raise ValueError(f'point_range: expected (x, y, z, x, y, z), least then greatest, got {point_range}')
    return limits
