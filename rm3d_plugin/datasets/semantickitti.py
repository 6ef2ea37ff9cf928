"""SemanticKITTI in its native layout."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.datasets.base import BadScenes, DatasetNotFoundError, Labels, SceneDataset, Truth
from rm3d_plugin.datasets.kitti_format import check_points, read_velodyne
from rm3d_plugin.datasets.semantickitti_format import (
    CLASSES,
    NUM_THINGS,
    merge_ids,
    number_instances,
    read_labels,
    read_lidar_poses,
)
from rm3d_plugin.datasets.thinned import Thinned, check_voxel, thin_voxels
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError

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
class SemanticKittiDataset(SceneDataset):
    """SemanticKITTI: one scan, one scene named ``NN_000000``; lidar frame, z up, the sensor at the origin.

    Classes are the benchmark's 19, moving things merged with resting ones; its thing classes have instances.

    Args:
        data_root: Folder that holds ``sequences``.
        split: The benchmark's: train 00-07, 09, 10; val 08; trainval both; test 11-21, which has no labels.
        sequences: Take these instead of the split's, each of which must be there.
        every: Take each ``every``-th scan of a sequence, from its first on.
        labels: See :class:`SceneDataset`; 'truth' is refused for the splits that train.
        label_store: See :class:`SceneDataset`.
        pipeline: See :class:`SceneDataset`.
        classes: Names of the 19 classes; their order is the benchmark's.
        voxel_thin: Keep one point in each voxel of this edge, metres; None: every point.
        bad_scenes: See :class:`SceneDataset`.
        seed: See :class:`SceneDataset`.

    Raises:
        DatasetNotFoundError: Nothing at data_root, or none of the sequences.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        sequences: Sequence[int] | None = None,
        every: int = 1,
        labels: Labels = 'none',
        label_store: str | Path | None = None,
        pipeline: Sequence[Mapping[str, Any] | Callable[[dict[str, Any]], dict[str, Any]]] = (),
        classes: Sequence[str] = CLASSES,
        voxel_thin: float | None = None,
        bad_scenes: BadScenes = 'error',
        seed: int = 0,
    ) -> None:
        super().__init__(classes, pipeline, labels, label_store, bad_scenes, seed)
        if split not in get_args(Split):
            raise ValueError(f'split: expected one of {", ".join(get_args(Split))}, got {split!r}')
        if labels == 'truth' and split != 'val':
            raise ValueError(
                f"labels='truth' is for split 'val', where metrics need it, got {split!r}; training reads "
                "labels='store', prediction needs labels='none'. Other sequences to measure on: sequences=[...]"
            )
        if len(self.classes) != len(CLASSES):
            raise ValueError(f'classes: SemanticKITTI has {len(CLASSES)}, got {len(self.classes)}')
        if every < 1:
            raise ValueError(f'every: expected 1 or more, got {every}')
        self.data_root = Path(data_root)
        self.split = split
        self.sequences = None if sequences is None else tuple(int(number) for number in sequences)
        self.every = int(every)
        self.voxel_thin = None if voxel_thin is None else check_voxel(voxel_thin)

    @property
    def thing_classes(self) -> tuple[int, ...]:
        """Numbers of the classes that have instances: car to motorcyclist."""
        return tuple(range(NUM_THINGS))

    # ------------------------------------------------------------------ scenes

    def find_scenes(self) -> tuple[str, ...]:
        """Scans of the sequences, in order."""
        wanted = SEQUENCES[self.split] if self.sequences is None else self.sequences
        scans = {number: sorted(self._folder(number).glob('velodyne/*.bin'))[:: self.every] for number in wanted}
        missing = [f'{number:02d}' for number in wanted if not scans[number]]
        if missing and (self.sequences is not None or len(missing) == len(wanted)):
            raise DatasetNotFoundError(self._not_found(f'there are no scans of sequence {", ".join(missing)}'))
        if missing:
            warnings.warn(
                f'{self.data_root}: {len(missing)} of {len(wanted)} sequences of split {self.split!r} are not there '
                f'and left out: {", ".join(missing)}; sequences=[...] says which to take',
                stacklevel=2,
            )
        return tuple(f'{number:02d}_{path.stem}' for number in wanted for path in scans[number])

    def _folder(self, sequence: int) -> Path:
        return self.data_root / 'sequences' / f'{sequence:02d}'

    def _file(self, index: int, kind: str, ending: str) -> Path:
        sequence, _, scan = self.scene_ids[index].partition('_')
        return self._folder(int(sequence)) / kind / f'{scan}{ending}'

    def _not_found(self, what: str) -> str:
        root = self.data_root.resolve()
        return (
            f'SemanticKITTI was looked for at {root}, but {what}. Download scans and labels from '
            f'http://semantic-kitti.org/dataset.html and lay them out so:\n{_LAYOUT.format(root=root)}\n'
            'then pass --cfg-options data_root=FOLDER. Without the data, --demo runs on synthetic scenes.'
        )

    # ------------------------------------------------------------------ one scene

    def load_cloud(self, index: int) -> PointCloud:
        """Points with their remission as intensity."""
        points = self._points(index)
        kept = self._thinned(points).kept
        intensity = np.clip(points[kept, 3], 0.0, 1.0)
        return PointCloud(xyz=points[kept, :3], intensity=intensity, sensor=(0.0, 0.0, 0.0))

    def load_truth(self, index: int) -> Truth:
        """Classes and instances of the points of :meth:`load_cloud`.

        Raises:
            SceneError: split='test' has none, or the label file cannot be used.
        """
        if self.split == 'test':
            raise SceneError(
                f'scene {self.scene_ids[index]}: SemanticKITTI keeps the labels of its test scans to itself; '
                'use split="val"'
            )
        points = self._points(index)
        path = self._file(index, 'labels', '.label')
        raw = read_labels(path, len(points))
        kept = self._thinned(points).kept
        semantic = merge_ids(raw.semantic, path)[kept]
        return Truth(Boxes3D.empty(), semantic, number_instances(semantic, raw.instance[kept]))

    def original_index(self, index: int) -> Int[np.ndarray, ' originals']:
        """For each point of the file, the row of the point of :meth:`load_cloud` that stands for it."""
        return self._thinned(self._points(index)).rows

    def pose(self, index: int) -> Float[np.ndarray, '4 4'] | None:
        """World from lidar, or None where the sequence has no poses.

        Raises:
            SceneError: ``poses.txt`` has no row for this scan.
        """
        sequence, _, scan = self.scene_ids[index].partition('_')
        poses = read_lidar_poses(self._folder(int(sequence)))
        if poses is None:
            return None
        if int(scan) >= len(poses):
            raise SceneError(f'{self._folder(int(sequence)) / "poses.txt"}: {len(poses)} rows, none for scan {scan}')
        return poses[int(scan)]

    def check_scene(self, index: int) -> None:
        """Read the points, and the labels where training or a metric may need them.

        Raises:
            SceneError: The scan cannot be used.
        """
        if self.split == 'test' or (self.labels == 'none' and not self._file(index, 'labels', '.label').is_file()):
            self.load_cloud(index)
        else:
            self.load_truth(index)  # reads the points, too

    def _points(self, index: int) -> Float[np.ndarray, 'points 4']:
        path = self._file(index, 'velodyne', '.bin')
        points = read_velodyne(path)
        check_points(points, path)
        return points

    def _thinned(self, points: Float[np.ndarray, 'points 4']) -> Thinned:
        return thin_voxels(points[:, :3], self.voxel_thin)
