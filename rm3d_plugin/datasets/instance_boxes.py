"""Boxes around the instances of a data set with instance labels, as ScanNet's and S3DIS's detection is told."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rm3d_plugin.datasets.boxes import BoxDataset
from rm3d_plugin.datasets.segmentation import SegmentationDataset
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError

THINNEST = 1e-3  # m; a flat thing, a picture on a wall, has a box, too


@DATASETS.register_module()
class InstanceBoxDataset(BoxDataset):
    """Scenes of a segmentation data set; the axis-aligned box of each instance is an object.

    As VoteNet and mmdetection3d make ScanNet's boxes: from the least to the greatest coordinate of the instance's
    points, with walls along the axes.

    Args:
        scenes: Registered type of the data set, such as 'ScanNetDataset' or 'S3DISDataset'.
        data_root: Its folder.
        split: Of that data set; all but 'train' may be scored.
        classes: Names of the classes that are objects, in the order of their numbers; None: all that have instances.
        min_points: Instances of fewer points are no objects.
        scene_options: Further arguments of the data set.
        common: Arguments of :class:`BoxDataset` and :class:`SceneDataset`.

    Raises:
        ValueError: A class has no instances there.
    """

    def __init__(
        self,
        scenes: str,
        data_root: str | Path,
        split: str = 'train',
        classes: Sequence[str] | None = None,
        min_points: int = 1,
        scene_options: dict[str, Any] | None = None,
        **common: Any,
    ) -> None:
        self.data_root = Path(data_root)
        options = {'data_root': data_root, 'split': split, **(scene_options or {})}
        self.source: SegmentationDataset = DATASETS.build({'type': scenes, **options})
        things = [self.source.classes[number] for number in self.source.thing_classes]
        if strange := [name for name in classes or () if name not in things]:
            raise ValueError(
                f'classes: {strange[0]!r} has no instances in {scenes}; expected some of {", ".join(things)}'
            )
        super().__init__(split, classes=things if classes is None else classes, **common)
        self.min_points = min_points

    def find_scenes(self) -> tuple[str, ...]:
        """Those of the data set."""
        return self.source.scene_ids

    def _index(self, index: int) -> int:
        return self.source.scene_ids.index(self.scene_ids[index])  # bad ones may be left out

    def read_cloud(self, index: int) -> PointCloud:
        """The points of a scene."""
        return self.source.load_cloud(self._index(index))

    def read_boxes(self, index: int, cloud: PointCloud) -> Boxes3D:
        """Boxes of the instances of the classes, by number of the instance."""
        truth = self.source.load_truth(self._index(index))
        if truth.instance is None or truth.semantic is None:
            raise SceneError(f'scene {self.scene_ids[index]}: has no instances; boxes need them')
        xyz = self.source.load_cloud(self._index(index)).xyz.astype(np.float64)
        names = np.array([*(_number(self.classes, name) for name in self.source.classes), -1])
        rows, labels = [], []
        order = np.argsort(truth.instance, kind='stable')
        numbers, first = np.unique(truth.instance[order], return_index=True)
        for number, points in zip(numbers, np.split(order, first[1:]), strict=True):
            label = int(names[truth.semantic[points[0]]])
            if number >= 0 and label >= 0 and len(points) >= self.min_points:
                low, high = xyz[points].min(axis=0), xyz[points].max(axis=0)
                rows.append([*(low + high) / 2, *np.maximum(high - low, THINNEST), 0.0])
                labels.append(label)
        return Boxes3D(np.array(rows).reshape(-1, 7), np.array(labels, dtype=np.int64))

    def is_labelled(self, index: int) -> bool:
        """All but a test split that keeps its labels to itself."""
        return self.source.read_scene(self._index(index)).semantic is not None if self.split == 'test' else True


def _number(classes: Sequence[str], name: str) -> int:
    return list(classes).index(name) if name in classes else -1
