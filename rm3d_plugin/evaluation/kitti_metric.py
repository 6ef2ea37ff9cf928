"""KITTI's average precision as an mmengine metric."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float
from mmengine.logging import print_log

from rm3d_plugin.datasets.kitti_format import (
    DONT_CARE,
    IMAGE_SIZE,
    KittiCalib,
    KittiObject,
    boxes_to_objects,
    objects_to_boxes,
    write_objects,
)
from rm3d_plugin.evaluation.functional.kitti_ap import (
    LOOSE_IOU,
    METRICS,
    OFFICIAL_IOU,
    KittiDetections,
    KittiTruth,
    Metric,
    Sampling,
    kitti_ap,
)
from rm3d_plugin.evaluation.functional.kitti_matching import COUNTS, MIN_HEIGHT, pack_frames
from rm3d_plugin.evaluation.kitti_table import format_table, kitti_records
from rm3d_plugin.evaluation.point_fields import class_names, numpy_of
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord
from rm3d_plugin.registry import METRICS as METRIC_REGISTRY
from rm3d_plugin.structures import Boxes3D, SceneError, evaluated_fields

Frame = Literal['camera', 'lidar']
HARD = 2  # the most forgiving of the difficulties
SAMPLINGS: Mapping[Sampling, str] = {
    'official': 'sampled as the official program does',
    'interpolated': 'interpolated',
    'auto': 'sampled as the official program does from 41 truths on, interpolated below',
}
EMPTY = KittiDetections([], np.zeros((0, 4)), np.zeros((0, 7)), np.zeros(0))


@dataclass(frozen=True, eq=False)
class FrameResult:
    """Both sides of one frame; no tuple, as mmengine rebuilds tuples when it gathers results."""

    scene_id: str
    truth: KittiTruth
    found: KittiDetections


def camera_boxes(objects: Sequence[KittiObject]) -> Float[np.ndarray, 'objects 7']:
    """3D boxes as the official program has them: rows (x, z, -y, length, width, height, -ry) of middles, rect frame.

    They stand upright along the camera's y axis, which is not exactly the lidar's z axis.
    """
    rows = [(o.x, o.z, o.h / 2 - o.y, o.l, o.w, o.h, -o.ry) for o in objects]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def truth_from_objects(objects: Sequence[KittiObject], calib: KittiCalib, frame: Frame = 'lidar') -> KittiTruth:
    """Label lines as the evaluation wants them; 3D boxes in ``frame``, zeros for DontCare."""
    boxes = np.zeros((len(objects), 7))
    solid = [i for i, o in enumerate(objects) if o.type != DONT_CARE and min(o.h, o.w, o.l) > 0]
    kept = [objects[i] for i in solid]
    lidar = frame == 'lidar'
    boxes[solid] = objects_to_boxes(kept, calib, sorted({o.type for o in kept})).tensor if lidar else camera_boxes(kept)
    return KittiTruth(
        types=[o.type for o in objects],
        truncation=np.array([o.truncated for o in objects], dtype=np.float64),
        occlusion=np.array([o.occluded for o in objects], dtype=np.int64),
        bbox2d=np.array([o.bbox for o in objects], dtype=np.float64).reshape(-1, 4),
        boxes3d=boxes,
        alpha=np.array([o.alpha for o in objects], dtype=np.float64),
    )


def found_from_objects(objects: Sequence[KittiObject], boxes: Boxes3D, frame: Frame = 'lidar') -> KittiDetections:
    """Result lines and the lidar boxes that they were made from, row by row; 3D boxes in ``frame``."""
    assert boxes.scores is not None
    return KittiDetections(
        types=[o.type for o in objects],
        bbox2d=np.array([o.bbox for o in objects], dtype=np.float64).reshape(-1, 4),
        boxes3d=boxes.tensor if frame == 'lidar' else camera_boxes(objects),
        scores=boxes.scores,
        alpha=np.array([o.alpha for o in objects], dtype=np.float64),
    )


@METRIC_REGISTRY.register_module()
class KittiMetric(RecordedMetric):
    """Average precision of KITTI's classes, metrics and difficulties, in percent; see :func:`kitti_ap`.

    Reads of each sample ``pred_bboxes_3d``, ``pred_labels_3d``, ``pred_scores_3d`` (lidar frame) and metainfo
    ``scene_id`` and ``annotation`` (objects, calib, image_size), which the data set hands on with ``labels='truth'``.
    A box of the prediction that lies outside the image is no detection, as nobody could have labelled it. Whether a
    label counts depends on its 2D box; where none of a class does, the log says why, and there is no score. With the
    defaults the numbers are those of the official program on the files of ``export_dir``.

    Args:
        classes: Names of the predicted class numbers; None: those of the data set.
        iou_thresholds: Overlap above which a detection hits, for each class.
        loose_iou_thresholds: A second, more forgiving set, whose means end in ``_loose``; None: only the first.
        metrics: Any of 'bbox', 'aos', 'bev', '3d'.
        sampling: How the curve is sampled, see :func:`kitti_ap`.
        frame: 'camera': 3D boxes stand upright in the rectified camera frame, as labels and the official program have
            them. 'lidar': upright in the lidar frame, as the network has them.
        export_dir: Folder for one KITTI result file a frame, every digit, for the official program; None: none is
            written.
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        classes: Sequence[str] | None = None,
        iou_thresholds: Mapping[str, float] = OFFICIAL_IOU,
        loose_iou_thresholds: Mapping[str, float] | None = LOOSE_IOU,
        metrics: Sequence[Metric] = METRICS,
        sampling: Sampling = 'official',
        frame: Frame = 'camera',
        export_dir: str | Path | None = None,
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.classes = classes
        self.iou_sets = {'': dict(iou_thresholds)}
        if loose_iou_thresholds is not None:
            self.iou_sets['loose'] = dict(loose_iou_thresholds)
        self.metrics = tuple(metrics)
        if frame not in get_args(Frame):
            raise ValueError(f'KittiMetric.frame: expected one of {", ".join(get_args(Frame))}, got {frame!r}')
        self.sampling: Sampling = sampling
        self.frame: Frame = frame
        self.export_dir = None if export_dir is None else Path(export_dir)

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of the predicted class numbers."""
        return class_names(self.classes, self.dataset_meta, 'KittiMetric')

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Keep both sides of every frame of a batch."""
        for sample in data_samples:
            self.results.append(self._frame(evaluated_fields(sample)))

    def score(self, results: list[FrameResult]) -> list[ScoreRecord]:
        """The numbers over all frames; the table goes to the log."""
        truths, found = [r.truth for r in results], [r.found for r in results]
        records: list[ScoreRecord] = []
        for variant, thresholds in self.iou_sets.items():
            table = kitti_ap(truths, found, self.class_names, thresholds, self.metrics, self.sampling)
            records += kitti_records(table, variant)
        for line in uncounted(truths, self.class_names):
            print_log(f'KittiMetric: {line}', logger='current', level=logging.WARNING)
        title = f'KITTI average precision (%), boxes in the {self.frame} frame, {SAMPLINGS[self.sampling]}'
        print_log(f'{title}\n{format_table(records)}', logger='current')
        return records

    def _frame(self, fields: Mapping[str, Any]) -> FrameResult:
        scene_id = str(fields.get('scene_id', ''))
        objects, calib, image_size = _annotation(fields, scene_id)
        try:
            boxes = Boxes3D(*(numpy_of(fields[f'pred_{name}_3d']) for name in ('bboxes', 'labels', 'scores')))
        except KeyError as error:
            raise SceneError(
                f'scene {scene_id}: the sample has no {error}; the model must write it in predict'
            ) from None
        except ValueError as error:
            raise SceneError(f'scene {scene_id}: predicted boxes cannot be used: {error}') from error
        lines = boxes_to_objects(boxes, calib, self.class_names, image_size)
        seen = [i for i, o in enumerate(lines) if o.bbox[2] > o.bbox[0] and o.bbox[3] > o.bbox[1]]
        lines, boxes = [lines[i] for i in seen], boxes.select(np.array(seen, dtype=np.int64))
        if self.export_dir is not None:
            self.export_dir.mkdir(parents=True, exist_ok=True)
            write_objects(self.export_dir / f'{scene_id}.txt', lines, full_precision=True)
        truth = truth_from_objects(objects, calib, self.frame)
        return FrameResult(scene_id, truth, found_from_objects(lines, boxes, self.frame))


def uncounted(truths: Sequence[KittiTruth], classes: Sequence[str]) -> list[str]:
    """A sentence for each class of which there is truth, but none that counts at any difficulty."""
    rows = pack_frames(truths, [EMPTY] * len(truths), classes)
    lines = []
    for name in classes:
        own = rows.truth_types == name.lower()
        if not own.any() or (rows.task(name, HARD, 'bbox').truth_role == COUNTS).any():
            continue
        small = int((own & (rows.truth_height < MIN_HEIGHT[HARD])).sum())
        lines.append(
            f'none of the {int(own.sum())} labels {name} counts: {small} have a 2D box less than {MIN_HEIGHT[HARD]:g} '
            'pixels high (zeros and -1 too), the others are too occluded or truncated; give labels the 2D boxes that '
            "KITTI's rules ask for"
        )
    return lines


def _annotation(fields: Mapping[str, Any], scene_id: str) -> tuple[Sequence[KittiObject], KittiCalib, tuple[int, int]]:
    whole = fields.get('annotation')
    if whole is not None:
        return whole.objects, whole.calib, whole.image_size
    objects, calib = fields.get('kitti_objects'), fields.get('calib')
    if objects is None or calib is None:
        raise SceneError(
            f"scene {scene_id}: the sample carries no KITTI annotation; give the evaluated data set labels='truth' "
            "and keep metainfo 'annotation' in its pipeline"
        )
    items = [o if isinstance(o, KittiObject) else KittiObject(**o) for o in objects]
    return items, calib, tuple(fields.get('image_size', IMAGE_SIZE))
