"""S3DIS (Stanford large-scale indoor spaces) in its native layout."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rm3d_plugin.datasets.base import check_choice, not_found
from rm3d_plugin.datasets.s3dis_format import AREAS, CLASSES, list_objects, read_room
from rm3d_plugin.datasets.segmentation import (
    RawScene,
    SegmentationDataset,
    check_classes,
    make_cloud,
    numbers_of_things,
    only_things,
)
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.plain_files import visible
from rm3d_plugin.storage.scans import unit_colors

Split = Literal['train', 'test']
_LAYOUT = """
    {root}/                                     Stanford3dDataset_v1.2_Aligned_Version
      Area_1/
        conferenceRoom_1/
          Annotations/   ceiling_1.txt  chair_1.txt  chair_2.txt ...    lines of x y z r g b
        office_1/ ...
      Area_2/ ... Area_6/
"""


@DATASETS.register_module()
class S3DISDataset(SegmentationDataset):
    """S3DIS: one room, one scene; 13 classes by the names of the annotation files, every object an instance.

    Text is parsed once and kept in ``cache``.

    Args:
        data_root: Folder that holds ``Area_1`` to ``Area_6``.
        split: 'test': the rooms of ``test_area``; 'train': those of the other areas.
        test_area: 1 to 6; six-fold cross-validation takes each in turn.
        classes: Names of the 13 classes, in this order: ceiling, floor, wall, beam, column, window, door, table, chair,
            sofa, bookcase, board, clutter.
        things: Names of the classes that have instances; S3DIS' protocol counts all, also ceiling and floor.
        cache: See :class:`SegmentationDataset`.
        common: Arguments of :class:`SegmentationDataset` and :class:`SceneDataset`.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        test_area: int = 5,
        classes: Sequence[str] = CLASSES,
        things: Sequence[str] = CLASSES,
        cache: str | Path | None = 'work_dirs/scene_cache',
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        if test_area not in AREAS:
            raise ValueError(f'test_area: expected 1 to 6, got {test_area!r}')
        super().__init__(split, cache=cache, classes=classes, **common)
        check_classes('S3DIS', self.classes, len(CLASSES))
        self._thing_classes = numbers_of_things(things, self.classes)
        self.data_root = Path(data_root)
        self.test_area = test_area

    # ------------------------------------------------------------------ scenes

    @property
    def areas(self) -> tuple[int, ...]:
        """Areas of the split."""
        return tuple(area for area in AREAS if (area == self.test_area) == (self.split == 'test'))

    def find_scenes(self) -> tuple[str, ...]:
        """Rooms as ``Area_5_office_3``, by area and name; a warning tells areas and rooms that are not there."""
        folders = [
            (area, folder)
            for area in self.areas
            for folder in sorted(visible(self.data_root.glob(f'Area_{area}/*')))
            if folder.is_dir()
        ]
        rooms = [f'Area_{area}_{folder.name}' for area, folder in folders if _is_room(folder)]
        if not rooms:
            areas = ', '.join(f'Area_{area}' for area in self.areas)
            source = 'Ask for it at http://buildingparser.stanford.edu/dataset.html'
            raise not_found(
                'S3DIS', self.data_root, f'there is no room in {areas}', source, _LAYOUT, 'Area_*/*/Annotations'
            )
        if missing := [f'Area_{area}' for area in self.areas if not any(found == area for found, _ in folders)]:
            warnings.warn(f'{self.data_root}: no rooms in {", ".join(missing)}; they are left out', stacklevel=2)
        if empty := [folder for _, folder in folders if not _is_room(folder)]:
            warnings.warn(
                f'{empty[0]}: no folder Annotations, so it is left out ({len(empty)} such folders); copy it again',
                stacklevel=2,
            )
        return tuple(rooms)

    # ------------------------------------------------------------------ one scene

    @property
    def thing_classes(self) -> tuple[int, ...]:
        """Numbers of ``things``."""
        return self._thing_classes

    def read_scene(self, index: int) -> RawScene:
        """Every point of a room's annotation files, by class name and number of the object."""
        area, room = self.scene_ids[index][:6], self.scene_ids[index][7:]
        objects = list_objects(self.data_root / area / room / 'Annotations')
        paths = tuple(item.path for item in objects)
        arrays = self.parsed('s3dis', paths, lambda: read_room(objects)._asdict())
        semantic, instance = arrays['semantic'].astype(np.int64), arrays['instance'].astype(np.int64)
        cloud = make_cloud(arrays['xyz'], colors=unit_colors(arrays['colors'], 'auto', paths[0].parent))
        return RawScene(cloud, semantic, only_things(instance, semantic, self.thing_classes))


def _is_room(folder: Path) -> bool:
    return (folder / 'Annotations').is_dir() or (folder / f'{folder.name}.txt').is_file()
