"""Boxes for scans that nobody labelled."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from mmengine.dataset import pseudo_collate
from tqdm import tqdm

from rm3d_plugin.datasets.base import features
from rm3d_plugin.datasets.kitti_format import (
    KittiCalib,
    boxes_to_objects,
    check_points,
    in_camera_view,
    read_calib,
    read_velodyne,
    write_objects,
)
from rm3d_plugin.inference.trained import TrainedNetwork, load_network
from rm3d_plugin.storage import write_json
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError

IMAGE_SIZE = (1242, 375)  # pixels; KITTI's usual frame, used where there is no image


@dataclass(frozen=True, eq=False)
class Detector:
    """A trained detector with everything it needs to read a scan.

    Attributes:
        model: The network, in evaluation mode.
        pipeline: Test-time transforms.
        classes: Class names.
        point_range: (x, y, z, x, y, z) metres, what the network was trained to see.
    """

    model: Any
    pipeline: list[Any]
    classes: tuple[str, ...]
    point_range: tuple[float, ...]

    @classmethod
    def load(cls, checkpoint: str | Path, device: str = 'cpu') -> 'Detector':
        """Rebuild the network from a checkpoint of this project; the config travels inside as plain data.

        Raises:
            ConfigError: No such file, or a checkpoint of another program.
        """
        return cls.from_network(load_network(checkpoint, device))

    @classmethod
    def from_network(cls, network: TrainedNetwork) -> 'Detector':
        """The same of a network that is loaded already."""
        dataset = network.config.val_dataloader.dataset
        return cls(network.model, network.pipeline, tuple(dataset.classes), tuple(dataset.point_range))

    def detect(self, cloud: PointCloud, name: str = 'scan') -> Boxes3D:
        """Find the objects in a cloud (lidar frame, z up, x forward).

        Args:
            cloud: Points with intensity.
            name: For error messages.
        """
        item: dict[str, Any] = {'scene_id': name, 'index': 0, 'num_points': len(cloud), 'points': features(cloud)}
        item['point_index'] = torch.arange(len(cloud)).numpy()
        for step in self.pipeline:
            item = step(item)
        with torch.no_grad():
            sample = self.model.test_step(pseudo_collate([item]))[0]
        return Boxes3D(
            sample.pred_bboxes_3d.cpu().numpy(),
            sample.pred_labels_3d.cpu().numpy(),
            sample.pred_scores_3d.cpu().numpy(),
        )


def calib_beside(scan: Path) -> Path | None:
    """The calibration of a scan in KITTI's layout (``../calib/NAME.txt``), or None."""
    path = scan.parent.parent / 'calib' / f'{scan.stem}.txt'
    return path if path.is_file() else None


def read_scan(path: Path, point_range: tuple[float, ...], calib: KittiCalib | None) -> PointCloud:
    """Read a ``.bin`` scan of float32 x, y, z, intensity; crop to range and, with a calibration, to the camera's view.

    Raises:
        SceneError: The file cannot be used, or no point is left.
    """
    points = read_velodyne(path)
    check_points(points, path)
    keep = ((points[:, :3] >= point_range[:3]) & (points[:, :3] < point_range[3:])).all(axis=1)
    if calib is not None:
        keep &= in_camera_view(points, calib, IMAGE_SIZE)
    if not keep.any():
        raise SceneError(f'{path}: none of its {len(points)} points lies in the range {list(point_range)} (metres)')
    return PointCloud(xyz=points[keep, :3], intensity=points[keep, 3], sensor=(0.0, 0.0, 0.0))


def predict_boxes(detector: Detector, scans: Sequence[Path], out: Path, min_score: float) -> Iterator[Path]:
    """Detect in each scan; write ``NAME.json`` (lidar frame), and ``NAME.txt`` (KITTI) where a calibration is found.

    Yields:
        Each file when it is written.

    Raises:
        SceneError: A scan cannot be used; files already written stay.
    """
    for scan in tqdm(scans, desc='predict', unit='scan', disable=None):
        calib_path = calib_beside(scan)
        calib = None if calib_path is None else read_calib(calib_path)
        boxes = detector.detect(read_scan(scan, detector.point_range, calib), scan.name)
        assert boxes.scores is not None
        boxes = boxes.select(boxes.scores >= min_score)
        yield write_json(out / f'{scan.stem}.json', _as_json(scan, boxes, detector.classes))
        if calib is not None:
            objects = boxes_to_objects(boxes, calib, detector.classes, IMAGE_SIZE)
            write_objects(out / f'{scan.stem}.txt', objects)
            yield out / f'{scan.stem}.txt'


def _as_json(scan: Path, boxes: Boxes3D, classes: tuple[str, ...]) -> dict[str, Any]:
    assert boxes.scores is not None
    rows = zip(boxes.tensor, boxes.labels, boxes.scores, strict=True)
    return {
        'scan': scan.name,
        'frame': 'lidar: x forward, y left, z up; metres; yaw in radians, counter-clockwise from x',
        'boxes': [
            {
                'class': classes[label],
                'score': round(float(score), 4),
                'center': [round(float(v), 3) for v in box[:3]],
                'size': [round(float(v), 3) for v in box[3:6]],
                'yaw': round(float(box[6]), 4),
            }
            for box, label, score in rows
        ],
    }
