"""KITTI object detection in its native layout."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from rm3d_plugin.datasets.base import (
    BadScenes,
    DatasetNotFoundError,
    Labels,
    SceneDataset,
    Truth,
    check_choice,
    not_found,
)
from rm3d_plugin.datasets.boxes import checked_range, within
from rm3d_plugin.datasets.kitti_format import (
    KittiCalib,
    KittiObject,
    check_points,
    in_camera_view,
    objects_to_boxes,
    read_calib,
    read_image_size,
    read_objects,
    read_velodyne,
)
from rm3d_plugin.ops.boxes import points_in_boxes
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.storage.plain_files import files_ending, read_list
from rm3d_plugin.structures import UNLABELLED, Boxes3D, PointCloud, SceneError

Split = Literal['train', 'val', 'trainval', 'test']
# Objects that look like a class but count as none: their points are neither the class nor background.
NEIGHBOURS = {'Car': ('Van', 'Truck'), 'Pedestrian': ('Person_sitting',), 'Cyclist': ()}
_LAYOUT = """
    {root}/
      ImageSets/   train.txt  val.txt      one frame number a line (000000); not part of KITTI's download
      training/
        velodyne/  000000.bin ...          data_object_velodyne.zip
        calib/     000000.txt ...          data_object_calib.zip
        label_2/   000000.txt ...          data_object_label_2.zip
        image_2/   000000.png ...          data_object_image_2.zip (optional: image sizes)
      testing/     velodyne/  calib/       the same, for split='test'
"""


class KittiAnnotation(NamedTuple):
    """What KITTI's metric needs of a frame: its label lines and its calibration."""

    objects: tuple[KittiObject, ...]
    calib: KittiCalib
    image_size: tuple[int, int]


@DATASETS.register_module()
class KittiDataset(SceneDataset):
    """KITTI object detection: one frame, one scene; lidar frame, z up, the sensor at the origin.

    Args:
        data_root: Folder that holds ``training`` and ``ImageSets``.
        split: 'test' reads ``testing`` and has no ground truth; the others read ``training``.
        ann_file: List of frames, relative to data_root; None: every frame there is.
        labels: See :class:`SceneDataset`; 'truth' is refused for every split but 'val'.
        label_store: See :class:`SceneDataset`.
        pipeline: See :class:`SceneDataset`.
        classes: Object types to learn, in the order of their numbers; the number after the last means background.
        point_range: (x, y, z, x, y, z) metres, least then greatest; points outside are dropped, and boxes whose centre
            lies outside in x or y.
        bad_scenes: See :class:`SceneDataset`.
        fov_only: Keep only what the left colour camera sees; KITTI labels nothing else.
        seed: See :class:`SceneDataset`.

    Raises:
        DatasetNotFoundError: Nothing at data_root, or the list of frames is missing.
    """

    def __init__(
        self,
        data_root: str | Path,
        split: Split = 'train',
        ann_file: str | None = 'ImageSets/train.txt',
        labels: Labels = 'none',
        label_store: str | Path | None = None,
        pipeline: Sequence[Mapping[str, Any] | Callable[[dict[str, Any]], dict[str, Any]]] = (),
        classes: Sequence[str] = ('Car', 'Pedestrian', 'Cyclist'),
        point_range: Sequence[float] = (0.0, -40.0, -3.0, 70.4, 40.0, 1.0),
        bad_scenes: BadScenes = 'error',
        fov_only: bool = True,
        seed: int = 0,
    ) -> None:
        super().__init__(classes, pipeline, labels, label_store, bad_scenes, seed)
        check_choice('split', split, get_args(Split))
        if labels == 'truth' and split != 'val':
            raise ValueError(
                f"labels='truth' is for split 'val', where metrics need it, got {split!r}; "
                "training reads labels='store', prediction needs labels='none'"
            )
        self.point_range = checked_range(point_range)
        self.data_root = Path(data_root)
        self.split = split
        self.folder = self.data_root / ('testing' if split == 'test' else 'training')
        self.ann_file = None if ann_file is None else self.data_root / ann_file
        self.fov_only = fov_only

    # ------------------------------------------------------------------ scenes

    def find_scenes(self) -> tuple[str, ...]:
        """Frame numbers of the list, or of every scan."""
        if self._velodyne is None:
            raise self._not_found(f'there is no {self.folder / "velodyne"}')
        if self.ann_file is None:
            return tuple(path.stem for path in files_ending(self._velodyne, '.bin'))
        if not self.ann_file.is_file():
            raise self._not_found(f'there is no list {self.ann_file}; ann_file=None takes every frame')
        frames = tuple(read_list(self.ann_file, words=True))
        doubled = len(frames) - len(set(frames))
        if doubled or not frames:
            raise SceneError(f'{self.ann_file}: {len(frames)} frames, {doubled} of them twice; list each frame once')
        return frames

    @property
    def _velodyne(self) -> Path | None:
        names = ('velodyne', 'velodyne_reduced')
        return next((self.folder / name for name in names if (self.folder / name).is_dir()), None)

    def _not_found(self, what: str) -> DatasetNotFoundError:
        source = 'Download it from https://www.cvlibs.net/datasets/kitti/eval_object.php'
        return not_found('KITTI', self.data_root, what, source, _LAYOUT, 'training/velodyne')

    # ------------------------------------------------------------------ one scene

    def load_cloud(self, index: int) -> PointCloud:
        """Points in range and, with ``fov_only``, in the camera's view; intensity is KITTI's reflectance."""
        scene_id = self.scene_ids[index]
        folder = self._velodyne
        if folder is None:
            raise self._not_found(f'there is no {self.folder / "velodyne"}')
        path = folder / f'{scene_id}.bin'
        points = read_velodyne(path)
        check_points(points, path)
        kept = points[within(points, self.point_range, axes=3)]
        if self.fov_only:
            kept = kept[in_camera_view(kept, self._calib(scene_id), self._image_size(scene_id))]
        if len(kept) == 0:
            raise SceneError(f'{path}: none of {len(points)} points lies in range {self.point_range.tolist()} and view')
        return PointCloud(xyz=kept[:, :3], intensity=kept[:, 3], sensor=(0.0, 0.0, 0.0))

    def load_truth(self, index: int) -> Truth:
        """Boxes in range; points inside them, background elsewhere, -1 inside objects of neighbouring types."""
        objects, calib, _ = self.annotations(index)
        near = [name for cls in self.classes for name in NEIGHBOURS.get(cls, ()) if name not in self.classes]
        try:
            boxes = self._in_range(objects_to_boxes(objects, calib, self.classes))
            others = objects_to_boxes(objects, calib, near)
        except ValueError as error:
            raise SceneError(
                f'{self._label_file(self.scene_ids[index])}: {error}; correct or remove the line'
            ) from error
        xyz = self.load_cloud(index).xyz
        instance = points_in_boxes(xyz, boxes.tensor)
        semantic = np.full(len(xyz), len(self.classes), dtype=np.int64)
        semantic[points_in_boxes(xyz, others.tensor) >= 0] = UNLABELLED
        inside = instance >= 0
        semantic[inside] = boxes.labels[instance[inside]]
        return Truth(boxes, semantic, instance)

    def check_scene(self, index: int) -> None:
        """Read the points, and the labels of every frame that training or a metric may need.

        Raises:
            SceneError: The frame cannot be used.
        """
        trains = self.split in ('train', 'trainval') and (self.folder / 'label_2').is_dir()
        if trains or self.labels == 'truth':
            self.load_truth(index)  # reads the points, too
        else:
            self.load_cloud(index)

    def annotations(self, index: int) -> KittiAnnotation:
        """Label lines and calibration of a frame, for the metric.

        Raises:
            SceneError: split='test' has none, or a file cannot be read.
        """
        scene_id = self.scene_ids[index]
        if self.split == 'test':
            raise SceneError(f'scene {scene_id}: KITTI keeps the labels of its test frames to itself; use split="val"')
        objects = read_objects(self._label_file(scene_id))
        return KittiAnnotation(tuple(objects), self._calib(scene_id), self._image_size(scene_id))

    def annotation(self, index: int) -> KittiAnnotation:
        """The same, for the base class."""
        return self.annotations(index)

    def _in_range(self, boxes: Boxes3D) -> Boxes3D:
        return boxes.select(within(boxes.tensor, self.point_range, axes=2))

    def _label_file(self, scene_id: str) -> Path:
        return self.folder / 'label_2' / f'{scene_id}.txt'

    def _calib(self, scene_id: str) -> KittiCalib:
        return read_calib(self.folder / 'calib' / f'{scene_id}.txt')

    def _image_size(self, scene_id: str) -> tuple[int, int]:
        return read_image_size(self.folder / 'image_2' / f'{scene_id}.png')
