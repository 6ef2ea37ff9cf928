"""ScanNet's instance average precision as an mmengine metric."""

from collections.abc import Sequence
from typing import Any

from mmengine.logging import print_log

from rm3d_plugin.evaluation.functional.instance_ap import MIN_POINTS, OVERLAPS, InstanceAp, instance_ap
from rm3d_plugin.evaluation.functional.instance_overlap import InstanceOverlap, instance_overlap
from rm3d_plugin.evaluation.point_fields import (
    chosen_classes,
    class_names,
    fields_of,
    format_columns,
    numpy_of,
    percent,
    point_truth,
)
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, share
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import SceneError


def overlap_of_sample(sample: Any, classes: Sequence[int], metric: str) -> InstanceOverlap:
    """Sizes and overlaps of a sample's ``pred_instance_masks``, ``_labels`` and ``_scores`` and its true instances.

    Raises:
        SceneError: A field is absent or does not fit.
    """
    names = ('pred_instance_masks', 'pred_instance_labels', 'pred_instance_scores')
    fields = fields_of(sample, names, metric)
    masks, labels, scores = (numpy_of(fields[name]) for name in names)
    if masks.ndim != 2:
        raise SceneError(
            f'{metric}: scene {fields.get("scene_id", "")}: pred_instance_masks: expected (K, n), got {masks.shape}'
        )
    truth = point_truth(fields, masks.shape[1], metric)
    if truth.instance is None:
        raise SceneError(f'{metric}: scene {fields.get("scene_id", "")}: the sample has no pts_instance_mask')
    whole = truth.scatter(masks.astype(bool).T, False).T
    try:
        return instance_overlap(truth.semantic, truth.instance, whole, labels, scores, classes)
    except ValueError as error:
        raise SceneError(f'{metric}: scene {fields.get("scene_id", "")}: {error}') from error


@METRICS.register_module()
class InstanceSegMetric(RecordedMetric):
    """AP, AP50 and AP25 of instances, in percent; see :func:`instance_ap`.

    Reads of each sample ``pred_instance_masks`` (K, n), ``pred_instance_labels`` (K,), ``pred_instance_scores`` (K,),
    and the truth ``pts_semantic_mask`` and ``pts_instance_mask`` (n,) or that of the whole scene, see
    :func:`~rm3d_plugin.evaluation.point_fields.point_truth`.

    Args:
        classes: Names of the class numbers; None: those of the data set.
        instance_classes: Evaluated classes, by number or name; None: the data set's ``thing_classes``, or all.
        min_points: Smallest instance that counts.
        overlaps: Overlaps over which AP is a mean.
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        classes: Sequence[str] | None = None,
        instance_classes: Sequence[int | str] | None = None,
        min_points: int = MIN_POINTS,
        overlaps: Sequence[float] = OVERLAPS,
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.classes, self.instance_classes = classes, instance_classes
        self.min_points, self.overlaps = min_points, tuple(overlaps)

    @property
    def evaluated(self) -> tuple[int, ...]:
        """Evaluated class numbers."""
        names = class_names(self.classes, self.dataset_meta, 'InstanceSegMetric')
        return chosen_classes(self.instance_classes, names, self.dataset_meta, 'InstanceSegMetric')

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Keep sizes and overlaps of every scene of a batch, not its masks."""
        evaluated = self.evaluated
        self.results += [overlap_of_sample(sample, evaluated, 'InstanceSegMetric') for sample in data_samples]

    def score(self, results: list[InstanceOverlap]) -> list[ScoreRecord]:
        """The numbers over all scenes; the table goes to the log."""
        names = class_names(self.classes, self.dataset_meta, 'InstanceSegMetric')
        scores = instance_ap(results, self.evaluated, self.min_points, self.overlaps)
        print_log('Average precision of instances (%)\n' + format_ap(scores, names), logger='current')
        return [
            *(
                share(f'{measure}_{names[label]}', float(values[column]), 'instances', measure, subject=names[label])
                for column, label in enumerate(scores.classes)
                for measure, values in (('AP', scores.ap), ('AP50', scores.ap50), ('AP25', scores.ap25))
            ),
            share('AP', scores.mean_ap, 'instances', 'AP'),
            share('AP50', scores.mean_ap50, 'instances', 'AP50', headline='AP50 of instances'),
            share('AP25', scores.mean_ap25, 'instances', 'AP25'),
        ]


def format_ap(scores: InstanceAp, names: Sequence[str]) -> str:
    """A line for each class and one for the means."""
    rows = zip(scores.classes, scores.ap, scores.ap50, scores.ap25, strict=True)
    lines = [(names[label], percent(ap), percent(ap50), percent(ap25)) for label, ap, ap50, ap25 in rows]
    mean = ('mean', percent(scores.mean_ap), percent(scores.mean_ap50), percent(scores.mean_ap25))
    return format_columns(('class', 'AP', 'AP50', 'AP25'), [*lines, mean])
