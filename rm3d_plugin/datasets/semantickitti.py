"""SemanticKITTI in its native layout."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from rm3d_plugin.datasets.base import DatasetNotFoundError, check_choice, not_found
from rm3d_plugin.datasets.kitti_format import check_points, read_velodyne
from rm3d_plugin.datasets.segmentation import RawScene, SegmentationDataset, check_classes
from rm3d_plugin.datasets.semantickitti_format import (
    CLASSES,
    NUM_THINGS,
    merge_ids,
    number_instances,
    read_labels,
    read_lidar_poses,
    unit_remission,
)
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.plain_files import files_ending
from rm3d_plugin.structures import PointCloud, SceneError

Split = Literal['train', 'val', 'trainval', 'test']
TRAIN, VAL, TEST = (0, 1, 2, 3, 4, 5, 6, 7, 9, 10), (8,), tuple(range(11, 22))
SEQUENCES: dict[str, tuple[int, ...]] = {'train': TRAIN, 'val': VAL, 'trainval': tuple(range(11)), 'test': TEST}
_LAYOUT = """
    {root}/sequences/
      00/ 01/ ... 21/
        velodyne/   000000.bin ...       KITTI odometry, velodyne laser data
        labels/     000000.label ...     SemanticKITTI labels (sequences 00 to 10)
        calib.txt  poses.txt             optional
"""


@DATASETS.register_module()
class SemanticKittiDataset(SegmentationDataset):
    """SemanticKITTI: one scan, one scene named ``NN_000000``; lidar frame, z up, the sensor at the origin.

    Classes are the benchmark's 19, moving things merged with resting ones; its thing classes have instances.

    Args:
        data_root: Folder that holds ``sequences``.
        split: The benchmark's: train 00-07, 09, 10; val 08; trainval both; test 11-21, which has no labels.
        sequences: Take these instead of the split's, each of which must be there.
        every: Take each ``every``-th scan of a sequence, from its first on.
        use_intensity: Hand on the remission; False where some scans have none.
        classes: Names of the 19 classes; their order is the benchmark's.
        common: Arguments of :class:`SegmentationDataset` and :class:`SceneDataset`.

    Raises:
        DatasetNotFoundError: Nothing at data_root, or none of the sequences.
        ValueError: A choice that there is not.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        sequences: Sequence[int] | None = None,
        every: int = 1,
        use_intensity: bool = True,
        classes: Sequence[str] = CLASSES,
        **common: Any,
    ) -> None:
        check_choice('split', split, get_args(Split))
        super().__init__(split, classes=classes, **common)
        check_classes('SemanticKITTI', self.classes, len(CLASSES))
        if not (1 <= every < float('inf') and every == int(every)):
            raise ValueError(f'every: expected a whole number from 1, got {every}')
        self.data_root = Path(data_root)
        self.sequences = None if sequences is None else _numbers(sequences)
        self.every = int(every)
        self.use_intensity = use_intensity

    @property
    def thing_classes(self) -> tuple[int, ...]:
        """Car to motorcyclist."""
        return tuple(range(NUM_THINGS))

    # ------------------------------------------------------------------ scenes

    def find_scenes(self) -> tuple[str, ...]:
        """Scans of the sequences, in order."""
        wanted = SEQUENCES[self.split] if self.sequences is None else self.sequences
        found = {number: files_ending(self._folder(number) / 'velodyne', '.bin') for number in wanted}
        self._tell_labels_alone(found)
        scans = {number: paths[:: self.every] for number, paths in found.items()}
        missing = [f'{number:02d}' for number in wanted if not scans[number]]
        if missing and (self.sequences is not None or len(missing) == len(wanted)):
            raise self._not_found(f'there are no scans of sequence {", ".join(missing)}')
        if missing:
            warnings.warn(
                f'{self.data_root}: {len(missing)} of {len(wanted)} sequences of split {self.split!r} are not there '
                f'and left out: {", ".join(missing)}; sequences=[...] says which to take',
                stacklevel=2,
            )
        return tuple(f'{number:02d}_{path.stem}' for number in wanted for path in scans[number])

    def _tell_labels_alone(self, scans: Mapping[int, Sequence[Path]]) -> None:
        """A warning where labels have no scan: its download was cut off."""
        for number, paths in scans.items():
            labels = {path.stem for path in files_ending(self._folder(number) / 'labels', '.label')}
            if paths and (alone := sorted(labels - {path.stem for path in paths})):
                warnings.warn(
                    f'{self._folder(number)}: {len(alone)} of {len(labels)} files of labels have no scan, and are left '
                    f'out (the first is {alone[0]}); unpack velodyne again',
                    stacklevel=3,
                )

    def _folder(self, sequence: int) -> Path:
        return self.data_root / 'sequences' / f'{sequence:02d}'

    def _file(self, index: int, kind: str, ending: str) -> Path:
        sequence, _, scan = self.scene_ids[index].partition('_')
        return self._folder(int(sequence)) / kind / f'{scan}{ending}'

    def _not_found(self, what: str) -> DatasetNotFoundError:
        source = 'Download it (scans and labels) from http://semantic-kitti.org/dataset.html'
        return not_found('SemanticKITTI', self.data_root, what, source, _LAYOUT, 'sequences/*/velodyne')

    # ------------------------------------------------------------------ one scene

    def read_scene(self, index: int) -> RawScene:
        """Points with their remission as intensity; classes and instances where there is a label file."""
        path = self._file(index, 'velodyne', '.bin')
        points = read_velodyne(path)
        check_points(points, path)
        intensity = unit_remission(points[:, 3], path) if self.use_intensity else None
        cloud = PointCloud(points[:, :3], intensity=intensity, sensor=(0.0, 0.0, 0.0))
        path = self._file(index, 'labels', '.label')
        if self.split == 'test' or not path.is_file():
            return RawScene(cloud)
        raw = read_labels(path, len(points))
        semantic = merge_ids(raw.semantic, path)
        return RawScene(cloud, semantic, number_instances(semantic, raw.instance))

    def why_no_truth(self, index: int) -> str:
        """Test scans have none; others miss a file."""
        if self.split == 'test':
            return 'SemanticKITTI keeps the labels of its test scans to itself; use split="val"'
        return f'{self._file(index, "labels", ".label")}: no such file; expected the labels of the scan'

    def pose(self, index: int) -> Float[np.ndarray, '4 4'] | None:
        """World from lidar, or None where the sequence has no poses.

        Raises:
            SceneError: ``poses.txt`` has no row for this scan.
        """
        sequence, _, scan = self.scene_ids[index].partition('_')
        poses = read_lidar_poses(self._folder(int(sequence)))
        if poses is None:
            return None
        if not scan.isdecimal():
            raise SceneError(f'{self._file(index, "velodyne", ".bin")}: expected a name like 000000.bin; rename it')
        if int(scan) >= len(poses):
            raise SceneError(f'{self._folder(int(sequence)) / "poses.txt"}: {len(poses)} rows, none for scan {scan}')
        return poses[int(scan)]


def _numbers(sequences: Sequence[int | str]) -> tuple[int, ...]:
    """Numbers of sequences, which may be written as their folders are: ``'00'``.

    Raises:
        ValueError: There is none, one is no number, or comes twice.
    """
    given = tuple(sequences)
    if isinstance(sequences, str) or not given or not all(str(number).isdecimal() for number in given):
        raise ValueError(f'sequences: expected a list of numbers, [0, 8], say, got {sequences!r}')
    numbers = tuple(int(number) for number in given)
    if len(set(numbers)) != len(numbers):
        raise ValueError(f'sequences: name each once, got {list(numbers)}')
    return numbers
