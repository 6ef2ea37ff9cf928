"""Panoptic quality of points as an mmengine metric."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Int
from mmengine.logging import print_log

from rm3d_plugin.evaluation.functional.panoptic_quality import (
    MIN_POINTS,
    Kind,
    PanopticCounts,
    PanopticScores,
    panoptic_counts,
    panoptic_scores,
)
from rm3d_plugin.evaluation.functional.semantic_iou import IGNORED, Absent
from rm3d_plugin.evaluation.point_fields import (
    chosen_classes,
    class_names,
    fields_of,
    format_columns,
    ignored_values,
    numpy_of,
    percent,
    point_truth,
    semantic_rows,
)
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, share
from rm3d_plugin.ops.segment import first_mask
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import SceneError

NAME = 'PanopticQuality'


@METRICS.register_module()
class PanopticQuality(RecordedMetric):
    """PQ, SQ, RQ and IoU of classes, things and stuff, in percent; see :func:`panoptic_counts`.

    Reads of each sample the classes that :class:`SemSegMetric` reads, and as their instances ``pred_pts_instance_mask``
    (n,), or ``pred_instance_masks`` (K, n) with ``pred_instance_scores`` (K,), of which a point takes the surest mask
    that holds it. Truth: ``pts_semantic_mask`` and ``pts_instance_mask`` (n,) or that of the whole scene, see
    :func:`~rm3d_plugin.evaluation.point_fields.point_truth`; points that were not predicted are then of no class.

    Args:
        classes: Names of the class numbers; None: those of the data set.
        instance_classes: Classes that have instances, by number or name; None: the data set's
            ``thing_classes``, or all.
        min_points: Smaller segments are neither missed nor wrong.
        ignored: True values that do not count.
        absent: 'zero' or 'skip' for a class without truth, see :func:`panoptic_scores`.
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        classes: Sequence[str] | None = None,
        instance_classes: Sequence[int | str] | None = None,
        min_points: int = MIN_POINTS,
        ignored: Sequence[int] = IGNORED,
        absent: Absent = 'zero',
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.classes, self.instance_classes = classes, instance_classes
        self.min_points, self.ignored = min_points, tuple(ignored)
        self.absent: Absent = absent

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Count the segments of every scene of a batch."""
        self.results += [self._count(sample) for sample in data_samples]

    def score(self, results: list[PanopticCounts]) -> list[ScoreRecord]:
        """The numbers over all scenes; the table goes to the log."""
        names = class_names(self.classes, self.dataset_meta, NAME)
        things = chosen_classes(self.instance_classes, names, self.dataset_meta, NAME)
        scores = panoptic_scores(sum(results, PanopticCounts.none(len(names))), things, self.absent)
        print_log('Panoptic quality (%)\n' + format_panoptic(scores, names), logger='current')
        return panoptic_records(scores, names)

    def _count(self, sample: Any) -> PanopticCounts:
        fields = fields_of(sample, [], NAME)
        semantic, instance = semantic_rows(fields, NAME), _instance_rows(fields)
        truth = point_truth(fields, len(semantic), NAME)
        where = f'{NAME}: scene {fields.get("scene_id", "")}'
        if truth.instance is None:
            raise SceneError(f'{where}: the sample has no pts_instance_mask')
        if len(instance) != len(semantic):
            raise SceneError(f'{where}: instances of {len(instance)} points, but classes of {len(semantic)}')
        count = len(class_names(self.classes, self.dataset_meta, NAME))
        found = truth.scatter(semantic, -1), truth.scatter(instance, -1)
        ignored = ignored_values(self.ignored, self.dataset_meta)
        return panoptic_counts(*found, truth.semantic, truth.instance, count, self.min_points, ignored)


def _instance_rows(fields: Any) -> Int[np.ndarray, ' rows']:
    """Found instance of each point, -1 = none."""
    if fields.get('pred_pts_instance_mask') is not None:
        return numpy_of(fields['pred_pts_instance_mask']).astype(np.int64)
    fields_of(fields, ['pred_instance_masks', 'pred_instance_scores'], NAME)
    masks, scores = numpy_of(fields['pred_instance_masks']), numpy_of(fields['pred_instance_scores'])
    return first_mask(masks.astype(bool)[np.argsort(-scores, kind='stable')])


def panoptic_records(scores: PanopticScores, names: Sequence[str]) -> list[ScoreRecord]:
    """PQ, SQ, RQ and IoU of each class, then the means."""
    measures = {'PQ': scores.quality, 'SQ': scores.segmentation, 'RQ': scores.recognition, 'IoU': scores.iou}
    kinds: dict[str, Kind] = {'': 'all', '_things': 'things', '_stuff': 'stuff'}
    return [
        *(
            share(f'{measure}_{name}', float(value), 'segments', measure, subject=name)
            for measure, values in measures.items()
            for name, value in zip(names, values, strict=True)
        ),
        share('PQ', scores.mean(scores.quality), 'segments', 'PQ', headline='PQ'),
        share('PQ_dagger', scores.dagger, 'segments', 'PQ-dagger'),
        share('mIoU', scores.mean(scores.iou), 'segments', 'IoU'),
        *(
            share(f'{measure}{ending}', scores.mean(measures[measure], kind), 'segments', f'{measure}{ending}')
            for ending, kind in kinds.items()
            for measure in ('PQ', 'SQ', 'RQ')
            if ending or measure != 'PQ'
        ),
    ]


def format_panoptic(scores: PanopticScores, names: Sequence[str]) -> str:
    """A line for each class and one for each mean."""
    columns = (scores.quality, scores.segmentation, scores.recognition, scores.iou)
    lines = [(name, *map(percent, values)) for name, *values in zip(names, *columns, strict=True)]
    kinds: tuple[Kind, ...] = ('all', 'things', 'stuff')
    lines += [(f'mean of {kind}', *(percent(scores.mean(column, kind)) for column in columns)) for kind in kinds]
    return format_columns(
        ('class', 'PQ', 'SQ', 'RQ', 'IoU'), [*lines, ('PQ-dagger', percent(scores.dagger), '', '', '')]
    )
