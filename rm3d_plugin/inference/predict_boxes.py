"""Boxes for scans that nobody labelled."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from mmengine.dataset import pseudo_collate
from tqdm import tqdm

from rm3d_plugin.datasets.base import features
from rm3d_plugin.datasets.box_formats import BOX_FORMATS
from rm3d_plugin.datasets.boxes import in_units, to_world, with_strength, within
from rm3d_plugin.datasets.kitti_format import IMAGE_SIZE, KittiCalib, in_camera_view, read_calib
from rm3d_plugin.datasets.named_boxes import NamedBoxes
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.evaluation.point_fields import numpy_of
from rm3d_plugin.inference.trained import TrainedNetwork, load_network
from rm3d_plugin.storage.scans import NanPoints, read_scan
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError


@dataclass(frozen=True)
class BoxOptions:
    """How scans are read and boxes are written.

    Attributes:
        format: A key of :data:`~rm3d_plugin.datasets.box_formats.BOX_FORMATS`; None: ``json``, and ``kitti`` beside it
            where a calibration is found.
        columns: What a table's columns hold, see :func:`rm3d_plugin.storage.scans.read_scan`.
        intensity_range: Lowest and greatest intensity of the sensor, which become 0 and 1; None: as the run's data set
            has it.
        nan_points: See :func:`rm3d_plugin.storage.scans.read_scan`.
    """

    format: str | None = None
    columns: str | None = None
    intensity_range: tuple[float, float] | None = None
    nan_points: NanPoints = 'error'

    def __post_init__(self) -> None:
        if self.format is not None and self.format not in BOX_FORMATS:
            raise ConfigError(f'--format of a detector: expected one of {", ".join(BOX_FORMATS)}, got {self.format!r}')

    def formats(self, calib: Path | None) -> tuple[str, ...]:
        """What is written of a scan.

        Raises:
            ConfigError: KITTI's format is asked for, but there is no calibration.
        """
        if self.format == 'kitti' and calib is None:
            raise ConfigError(
                '--format kitti: tells boxes in the frame of a camera, so each scan needs ../calib/NAME.txt; others '
                'need none'
            )
        if self.format is not None:
            return (self.format,)
        return ('json',) if calib is None else ('json', 'kitti')


@dataclass(frozen=True, eq=False)
class Detector:
    """A trained detector with everything it needs to read a scan.

    Attributes:
        model: The network, in evaluation mode.
        pipeline: Test-time transforms.
        classes: Class names.
        point_range: (x, y, z, x, y, z) metres, what the network was trained to see; None: everything.
        intensity_range: Strength that reads as 1, see :func:`~rm3d_plugin.datasets.boxes.with_strength`.
        camera_view: Whether it was trained on what a camera sees.
        unit: Metres that count as one to the network; clouds, range and boxes are in units.
    """

    model: Any
    pipeline: list[Any]
    classes: tuple[str, ...]
    point_range: tuple[float, ...] | None
    intensity_range: float | None = 1.0
    camera_view: bool = False
    unit: float = 1.0

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
        limits, kitti = dataset.get('point_range'), dataset.type == 'KittiDataset'
        return cls(
            network.model,
            network.pipeline,
            network.classes,
            None if limits is None else tuple(limits),
            1.0 if kitti else dataset.get('intensity_range'),
            kitti and bool(dataset.get('fov_only', True)),
            dataset.get('unit') or 1.0,
        )

    def crop(self, cloud: PointCloud, calib: KittiCalib | None, name: str) -> PointCloud:
        """What the network was trained to see of a cloud: its range, and with a calibration the camera's view.

        Raises:
            SceneError: No point is left.
        """
        keep = np.ones(len(cloud), dtype=bool)
        if self.point_range is not None:
            keep = within(cloud.xyz, np.asarray(self.point_range, dtype=np.float64), axes=3)
        if calib is not None and self.camera_view:
            keep &= in_camera_view(cloud.xyz, calib, IMAGE_SIZE)
        if not keep.any():
            limits = None if self.point_range is None else list(self.point_range)
            raise SceneError(f'{name}: none of its {len(cloud)} points lies in the range {limits} (metres)')
        return cloud.select(keep)

    def detect(self, cloud: PointCloud, name: str = 'scan') -> Boxes3D:
        """Find the objects in a cloud (z up; for a network trained on KITTI, the lidar's frame, x forward).

        Args:
            cloud: Points, with intensity or without.
            name: For error messages.
        """
        points = features(replace(self._with_strength(cloud), colors=None))
        item: dict[str, Any] = {'scene_id': name, 'index': 0, 'num_points': len(cloud), 'points': points}
        item['point_index'] = np.arange(len(cloud))
        for step in self.pipeline:
            item = step(item)
        with torch.no_grad():
            sample = self.model.test_step(pseudo_collate([item]))[0]
        return Boxes3D(*map(numpy_of, (sample.pred_bboxes_3d, sample.pred_labels_3d, sample.pred_scores_3d)))

    def _with_strength(self, cloud: PointCloud) -> PointCloud:
        """A sensor whose strengths exceed the range of the run is read by its own."""
        top = self.intensity_range
        if top is not None and cloud.intensity is not None and len(cloud) and float(cloud.intensity.max()) > top:
            top = None
        return with_strength(cloud, top)


def calib_beside(scan: Path) -> Path | None:
    """The calibration of a scan in KITTI's layout (``../calib/NAME.txt``), or None."""
    path = scan.parent.parent / 'calib' / f'{scan.stem}.txt'
    return path if path.is_file() else None


def box_targets(scan: Path, out: Path, options: BoxOptions) -> list[Path]:
    """The files that are written of a scan."""
    return [out / f'{scan.stem}{BOX_FORMATS[kind].ending}' for kind in options.formats(calib_beside(scan))]


def predict_boxes(
    detector: Detector, scans: Sequence[Path], out: Path, min_score: float, options: BoxOptions | None = None
) -> Iterator[Path]:
    """Detect in each scan and write its boxes, in the coordinates of its file.

    Yields:
        Each file when it is written.

    Raises:
        SceneError: A scan cannot be used; files already written stay.
    """
    options = options or BoxOptions()
    for scan in tqdm(scans, desc='predict', unit='scan', disable=None):
        calib_path = calib_beside(scan)
        calib = None if calib_path is None else read_calib(calib_path)
        cloud = detector.crop(in_units(_read(scan, options), detector.unit), calib, str(scan))
        boxes = detector.detect(cloud, scan.name)
        assert boxes.scores is not None
        boxes = boxes.select(boxes.scores >= min_score)
        named = NamedBoxes.from_boxes(to_world(boxes, np.asarray(cloud.origin), detector.unit), detector.classes)
        for kind in options.formats(calib_path):
            yield BOX_FORMATS[kind].write(out / f'{scan.stem}{BOX_FORMATS[kind].ending}', named, scan.name, calib)


def _read(scan: Path, options: BoxOptions) -> PointCloud:
    cloud = read_scan(scan, options.columns, nan_points=options.nan_points).cloud
    if cloud.intensity is None or options.intensity_range is None:
        return cloud
    low, high = options.intensity_range
    return replace(cloud, intensity=np.clip((cloud.intensity - low) / (high - low), 0.0, 1.0))
