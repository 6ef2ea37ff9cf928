"""Scenes of one data set for a network that learnt the classes of another."""

from collections.abc import Mapping
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from rm3d_plugin.class_names import class_index
from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.structures import UNLABELLED


@DATASETS.register_module()
class OtherClassesDataset(SegmentationDataset):
    """Scenes of a data set, their classes told as those of another one, by name; classes of no such name are ignored.

    So a network is tested on scenes of another family than it was trained on: on the classes that both have.

    Args:
        scenes: Registered type of the data set, such as 'S3DISDataset'.
        classes_of: Registered type of the data set whose classes the network predicts, such as 'ScanNetDataset'.
        data_root: Folder of the scenes.
        split: Of the data set of the scenes.
        scene_options: Further arguments of that data set.
        common: Arguments of :class:`SegmentationDataset` and :class:`SceneDataset`.

    Raises:
        ValueError: The data sets share no class.
    """

    def __init__(
        self,
        scenes: str,
        classes_of: str,
        data_root: str | Path,
        split: str = 'test',
        scene_options: Mapping[str, Any] | None = None,
        **common: Any,
    ) -> None:
        options = {'type': scenes, 'data_root': data_root, 'split': split, **(scene_options or {})}
        self.source: SegmentationDataset = DATASETS.build(options)
        self.data_root = Path(data_root)
        super().__init__(split, classes=class_names_of(classes_of), **common)
        self.numbers = numbers_by_name(self.source.classes, self.classes)
        if not (self.numbers >= 0).any():
            raise ValueError(f'{scenes} and {classes_of} share no class: {self.source.classes}, {self.classes}')

    def find_scenes(self) -> tuple[str, ...]:
        """Those of the data set."""
        return self.source.scene_ids

    @property
    def thing_classes(self) -> tuple[int, ...]:
        """Shared classes that have instances in the data set of the scenes."""
        told = self.numbers[list(self.source.thing_classes)]
        return tuple(sorted(int(number) for number in told if number >= 0))

    def read_scene(self, index: int) -> RawScene:
        """A scene with the other data set's class numbers; points of ignored classes are of no instance."""
        scene = self.source.read_scene(self.source.scene_ids.index(self.scene_ids[index]))  # bad ones may be left out
        if scene.semantic is None:
            return scene
        semantic = np.append(self.numbers, UNLABELLED)[scene.semantic]  # -1 takes the last
        instance = None if scene.instance is None else np.where(semantic >= 0, scene.instance, UNLABELLED)
        return RawScene(scene.cloud, semantic, instance)


def class_names_of(dataset: str) -> tuple[str, ...]:
    """Names of the classes that a registered data set has where nobody renames them.

    Raises:
        ValueError: There is no such data set, or its classes are those of its files.
    """
    kind = DATASETS.get(dataset)
    names = signature(kind).parameters.get('classes') if kind is not None else None
    if names is None or not isinstance(names.default, tuple):
        raise ValueError(f'classes_of: expected a data set with classes of its own, got {dataset!r}')
    return names.default


def numbers_by_name(names: tuple[str, ...], others: tuple[str, ...]) -> Int[np.ndarray, ' classes']:
    """Number that each name has among others; -1 for none.

    >>> numbers_by_name(('floor', 'beam', 'wall'), ('wall', 'floor')).tolist()
    [1, -1, 0]
    """
    found = (class_index(name, others) for name in names)
    return np.array([UNLABELLED if number is None else number for number in found], dtype=np.int64)
