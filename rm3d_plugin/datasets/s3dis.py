"""S3DIS (Stanford large-scale indoor spaces) in its native layout."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rm3d_plugin.datasets.base import BadScenes, DatasetNotFoundError, Labels
from rm3d_plugin.datasets.s3dis_format import AREAS, CLASSES, list_objects, read_room
from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset, file_key, make_cloud, only_things
from rm3d_plugin.registry import DATASETS

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
        labels: See :class:`SceneDataset`.
        label_store: See :class:`SceneDataset`.
        pipeline: See :class:`SceneDataset`.
        classes: Names of the 13 classes, in this order: ceiling, floor, wall, beam, column, window, door, table, chair,
            sofa, bookcase, board, clutter.
        things: Names of the classes that have instances; S3DIS' protocol counts all, also ceiling and floor.
        voxel_thin: See :class:`SegmentationDataset`.
        cache: See :class:`SegmentationDataset`.
        bad_scenes: See :class:`SceneDataset`.
        seed: See :class:`SceneDataset`.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        test_area: int = 5,
        labels: Labels = 'none',
        label_store: str | Path | None = None,
        pipeline: Sequence[Mapping[str, Any] | Callable[[dict[str, Any]], dict[str, Any]]] = (),
        classes: Sequence[str] = CLASSES,
        things: Sequence[str] = CLASSES,
        voxel_thin: float | None = None,
        cache: str | Path | None = 'work_dirs/scene_cache',
        bad_scenes: BadScenes = 'error',
        seed: int = 0,
    ) -> None:
        super().__init__(
            split,
            voxel_thin,
            cache,
            classes=classes,
            pipeline=pipeline,
            labels=labels,
            label_store=label_store,
            bad_scenes=bad_scenes,
            seed=seed,
        )
        if split not in get_args(Split):
            raise ValueError(f'split: expected one of {", ".join(get_args(Split))}, got {split!r}')
        if test_area not in AREAS:
            raise ValueError(f'test_area: expected 1 to 6, got {test_area!r}')
        if len(self.classes) != len(CLASSES):
            raise ValueError(f'classes: expected names for the {len(CLASSES)} classes of S3DIS, got {self.classes}')
        unknown = sorted(set(things) - set(self.classes))
        if unknown:
            raise ValueError(f'things: {unknown[0]!r} is no class; expected some of {", ".join(self.classes)}')
        self.data_root = Path(data_root)
        self.test_area = test_area
        self.things = tuple(things)

    # ------------------------------------------------------------------ scenes

    @property
    def areas(self) -> tuple[int, ...]:
        """Areas of the split."""
        return tuple(area for area in AREAS if (area == self.test_area) == (self.split == 'test'))

    def find_scenes(self) -> tuple[str, ...]:
        """Rooms as ``Area_5_office_3``, by area and name; areas that are not there are passed over."""
        rooms = [
            f'Area_{area}_{folder.name}'
            for area in self.areas
            for folder in sorted(self.data_root.glob(f'Area_{area}/*'))
            if (folder / 'Annotations').is_dir() or (folder / f'{folder.name}.txt').is_file()
        ]
        if not rooms:
            raise DatasetNotFoundError(self._not_found())
        return tuple(rooms)

    def _not_found(self) -> str:
        root = self.data_root.resolve()
        areas = ', '.join(f'Area_{area}' for area in self.areas)
        return (
            f'S3DIS was looked for at {root}, but there is no room in {areas}. Ask for it at '
            f'http://buildingparser.stanford.edu/dataset.html and lay it out so:\n{_LAYOUT.format(root=root)}\n'
            'then pass --cfg-options data_root=FOLDER. Without the data, --demo runs on synthetic scenes.'
        )

    # ------------------------------------------------------------------ one scene

    @property
    def thing_classes(self) -> tuple[int, ...]:
        """Numbers of ``things``."""
        return tuple(number for number, name in enumerate(self.classes) if name in self.things)

    def read_scene(self, index: int) -> RawScene:
        """Every point of a room's annotation files, by class name and number of the object."""
        area, room = self.scene_ids[index][:6], self.scene_ids[index][7:]
        arrays = self._room(self.data_root / area / room / 'Annotations')
        semantic, instance = arrays['semantic'].astype(np.int64), arrays['instance'].astype(np.int64)
        cloud = make_cloud(arrays['xyz'], colors=arrays['colors'] / np.float32(255))
        return RawScene(cloud, semantic, only_things(instance, semantic, self.thing_classes))

    def _room(self, folder: Path) -> dict[str, np.ndarray]:
        objects = list_objects(folder)
        if self.cache is None:
            return read_room(objects)._asdict()
        key = file_key('s3dis', tuple(item.path for item in objects))
        return self.cache.get_or_make(key, lambda: read_room(objects)._asdict())
