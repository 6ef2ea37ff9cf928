"""Waymo Open Dataset, perception v2, in its native parquet files."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rm3d_plugin.datasets.base import DatasetNotFoundError, check_choice, not_found
from rm3d_plugin.datasets.boxes import BoxDataset
from rm3d_plugin.datasets.waymo_format import (
    SPLITS,
    TYPES,
    FrameFiles,
    WaymoBoxes,
    read_boxes,
    read_points,
)
from rm3d_plugin.datasets.waymo_tables import frame_times
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.plain_files import files_ending, read_list
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError

Split = Literal['train', 'val', 'test']
COMPONENTS = ('lidar', 'lidar_calibration', 'lidar_pose', 'vehicle_pose', 'lidar_box')
_LAYOUT = """
    {root}/
      training/                                perception v2: gs://waymo_open_dataset_v_2_0_1
        lidar/              SEGMENT.parquet ...   range images, both returns
        lidar_calibration/  SEGMENT.parquet ...
        lidar_pose/         SEGMENT.parquet ...   of each pixel of the top lidar
        vehicle_pose/       SEGMENT.parquet ...
        lidar_box/          SEGMENT.parquet ...
      validation/  testing/                    the same; testing has no lidar_box
"""


@DATASETS.register_module()
class WaymoDataset(BoxDataset):
    """Waymo: one frame, one scene, ``SEGMENT_MICROSECONDS``; vehicle frame, z up, the origin on the ground.

    Intensities have no upper end, so each frame's own brightest count as 1. Points in zones that nobody labelled are
    left out, and boxes without a lidar point.

    Args:
        data_root: Folder that holds ``training`` and ``validation``.
        split: 'train', 'val' or 'test' (which has no boxes).
        ann_file: List of segments, one a line, relative to ``data_root``; None: every segment there is.
        every: Each so-many-th frame of a segment; 5 gives two frames a second.
        returns: Returns of each pulse to read, of 1 and 2.
        lasers: 1 top, 2 front, 3 side left, 4 side right, 5 rear.
        classes: Of Vehicle, Pedestrian and Cyclist.
        common: Arguments of :class:`BoxDataset` and :class:`SceneDataset`.

    Raises:
        DatasetNotFoundError: Nothing is there.
        SceneError: pyarrow is not installed.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        ann_file: str | None = None,
        every: int = 1,
        returns: Sequence[int] = (1, 2),
        lasers: Sequence[int] = (1, 2, 3, 4, 5),
        classes: Sequence[str] = tuple(TYPES),
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        for name in classes:
            check_choice('classes', name, tuple(TYPES))
        if every < 1 or not returns or not set(returns) <= {1, 2} or not set(lasers) <= {1, 2, 3, 4, 5}:
            raise ValueError(
                f'expected every >= 1, returns of 1, 2 and lasers of 1 to 5, got {every}, {returns}, {lasers}'
            )
        super().__init__(split, classes=classes, **common)
        self.data_root = Path(data_root)
        self.folder = self.data_root / SPLITS[split]
        self.ann_file = None if ann_file is None else self.data_root / ann_file
        self.every, self.returns, self.lasers = every, tuple(returns), tuple(lasers)
        self._frames: dict[str, tuple[str, int]] = {}

    # ------------------------------------------------------------------ scenes

    def find_scenes(self) -> tuple[str, ...]:
        """Frames of the segments by name and time."""
        self._frames = {}
        for segment in self._segments():
            path = self.files(segment).component('vehicle_pose')
            times = np.unique(frame_times(path))
            if len(times) == 0:
                raise SceneError(f'{path}: holds no frame; download it again, or take the segment off the list')
            for time in times[:: self.every].tolist():
                self._frames[f'{segment}_{time}'] = (segment, time)
        return tuple(self._frames)

    def _segments(self) -> list[str]:
        if not (self.folder / 'lidar').is_dir():
            raise self._not_found(f'there is no {self.folder / "lidar"}')
        there = [path.stem for path in files_ending(self.folder / 'lidar', '.parquet')]
        if self.ann_file is None:
            if not there:
                raise self._not_found(f'there is no segment in {self.folder / "lidar"}')
            return there
        if not self.ann_file.is_file():
            raise self._not_found(f'there is no list {self.ann_file}')
        named = read_list(self.ann_file, words=True)
        if missing := [name for name in named if name not in there]:
            raise SceneError(f'{self.ann_file}: segment {missing[0]} is not in {self.folder / "lidar"}; download it')
        if not named or len(set(named)) < len(named):
            raise SceneError(f'{self.ann_file}: expected each segment once, got {len(named)} lines')
        return named

    def _not_found(self, what: str) -> DatasetNotFoundError:
        return not_found(
            'Waymo', self.data_root, what, 'Download it from https://waymo.com/open', _LAYOUT, 'training/lidar'
        )

    def files(self, segment: str) -> FrameFiles:
        """The files of a segment."""
        return FrameFiles(self.folder, segment)

    def _frame(self, index: int) -> tuple[FrameFiles, int]:
        scene = self.scene_ids[index]  # finds the frames first
        segment, time = self._frames[scene]
        return self.files(segment), time

    # ------------------------------------------------------------------ one scene

    def read_cloud(self, index: int) -> PointCloud:
        """Points of the asked returns and lasers, those in no-label zones left out."""
        found = read_points(*self._frame(index), self.returns, self.lasers)
        if not found:
            raise SceneError(f'scene {self.scene_ids[index]}: no range image of lasers {self.lasers}')
        kept = [~part.in_no_label_zone for part in found]
        xyz = np.concatenate([part.xyz[keep] for part, keep in zip(found, kept, strict=True)])
        intensity = np.concatenate([part.intensity[keep] for part, keep in zip(found, kept, strict=True)])
        if bad := int((~np.isfinite(intensity)).sum()):
            warnings.warn(
                f'scene {self.scene_ids[index]}: the intensities of {bad} of {len(xyz)} points are NaN or infinite; '
                'they count as 0',
                stacklevel=2,
            )
            intensity = np.nan_to_num(intensity, nan=0.0, posinf=0.0, neginf=0.0)
        return PointCloud(xyz.astype(np.float32), intensity=intensity, sensor=found[0].sensor)

    def read_boxes(self, index: int, cloud: PointCloud) -> Boxes3D:
        """Boxes of the classes."""
        found = self.annotation(index)
        numbers = np.full(max(TYPES.values()) + 1, -1)
        numbers[[TYPES[name] for name in self.classes]] = np.arange(len(self.classes))
        labels = numbers[found.types]
        return Boxes3D(found.boxes[labels >= 0], labels[labels >= 0])

    def is_labelled(self, index: int) -> bool:
        """All but the test split."""
        return self.split != 'test'

    def annotation(self, index: int) -> WaymoBoxes:
        """Every box with its difficulty, for the metric.

        Raises:
            SceneError: split='test' has none.
        """
        if self.split == 'test':
            raise SceneError(
                f"scene {self.scene_ids[index]}: Waymo keeps the boxes of its test frames; use split='val'"
            )
        return read_boxes(*self._frame(index))
