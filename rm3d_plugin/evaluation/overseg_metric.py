"""Quality of a partition as an mmengine metric."""

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import add
from typing import Any

from rm3d_plugin.evaluation.functional.boundary import BoundaryCounts, boundary_counts, scores_of
from rm3d_plugin.evaluation.point_fields import numpy_of
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, share
from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import SceneError, evaluated_fields


@METRICS.register_module()
class OversegMetric(RecordedMetric):
    """Boundary recall, precision, F1 and oracle mIoU of regions, in percent; see :func:`boundary_counts`.

    Reads of each sample ``points`` (n, 3 or more columns), ``pts_semantic_mask``, ``pred_pts_region_mask`` (-1 =
    discarded) and, where it has one, ``pts_instance_mask``: then objects have the boundaries, otherwise classes. Edges
    and points of all scenes count together.

    Args:
        num_classes: Number of classes; None: as many as the data set names.
        neighbors: Nearest points that each point is joined to.
        tolerance: Edges that a boundary may be off.
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        num_classes: int | None = None,
        neighbors: int = 5,
        tolerance: int = 1,
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.num_classes = num_classes
        self.neighbors = neighbors
        self.tolerance = tolerance

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Count every scene of a batch."""
        for sample in data_samples:
            self.results.append(self._count(evaluated_fields(sample)))

    def score(self, results: list[BoundaryCounts]) -> list[ScoreRecord]:
        """The numbers over all scenes; nothing where there was no scene."""
        if not results:
            return []
        scores = scores_of(reduce(add, results))
        count = scores.regions / len(results)
        return [
            share('boundary_recall', scores.recall, 'regions', 'recall of boundaries'),
            share('boundary_precision', scores.precision, 'regions', 'precision of boundaries'),
            share('boundary_f1', scores.f1, 'regions', 'F1 of boundaries'),
            share('oracle_miou', scores.oracle_miou, 'regions', 'oracle mIoU'),
            share('oracle_accuracy', scores.oracle_accuracy, 'regions', 'oracle accuracy'),
            ScoreRecord('regions_per_scene', count, 'regions', 'regions a scene', unit=''),
        ]

    def _count(self, fields: Mapping[str, Any]) -> BoundaryCounts:
        needed = ('points', 'pts_semantic_mask', 'pred_pts_region_mask')
        if missing := [name for name in needed if fields.get(name) is None]:
            raise SceneError(f'OversegMetric: scene {fields.get("scene_id", "")}: the sample has no {missing}')
        xyz, classes, regions = (numpy_of(fields[name]) for name in needed)
        objects = fields.get('pts_instance_mask')
        objects = None if objects is None else numpy_of(objects)
        count = self.num_classes or len((self.dataset_meta or {}).get('classes', ()))
        if not count:
            raise ValueError('OversegMetric: no classes; pass num_classes or use a data set whose metainfo names them')
        return boundary_counts(xyz[:, :3], classes, regions, count, objects, self.neighbors, self.tolerance)
