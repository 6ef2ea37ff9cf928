"""Quality of the pseudo labels of a label store as an mmengine metric: for reports, never for training."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int
from mmengine.logging import print_log

from rm3d_plugin.evaluation.functional.pseudo_label_counts import PseudoLabelCounts, SceneTruth, count_pseudo_labels
from rm3d_plugin.evaluation.functional.pseudo_label_scores import PseudoLabelScores, pseudo_label_scores
from rm3d_plugin.evaluation.point_fields import (
    class_names,
    fields_of,
    format_columns,
    numpy_of,
    percent,
    point_truth,
)
from rm3d_plugin.evaluation.records import RecordedMetric, ScoreRecord, share
from rm3d_plugin.registry import METRICS
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import PseudoLabels, SceneError


@METRICS.register_module()
class PseudoLabelMetric(RecordedMetric):
    """Coverage and precision (percent) and offset error (metres) of a round; see :func:`pseudo_label_scores`.

    Reads of each sample ``scene_id``, ``point_index`` where points were dropped, the truth ``pts_semantic_mask`` and
    ``pts_instance_mask``, optionally ``pred_point_centers``, and of the batch the points' coordinates.

    Args:
        label_store: Folder of the label store.
        round: Which round; None: the one that training reads.
        classes: Names of the class numbers; None: those of the data set.
        range_edges: Lower ends of range bins, metres from the origin of the scan; None: no bins (rooms).
        collect_device: See mmengine.
        prefix: Put before every name, with a slash.
    """

    def __init__(
        self,
        label_store: str | Path,
        round: int | None = None,
        classes: Sequence[str] | None = None,
        range_edges: Sequence[float] | None = None,
        collect_device: str = 'cpu',
        prefix: str | None = None,
    ) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.store, self.round, self.classes = LabelStore(label_store), round, classes
        self.range_edges = None if range_edges is None else tuple(range_edges)

    def process(self, data_batch: Any, data_samples: Sequence[Any]) -> None:
        """Count every scene of a batch."""
        count = len(class_names(self.classes, self.dataset_meta, 'PseudoLabelMetric'))
        for row, sample in enumerate(data_samples):
            fields = fields_of(sample, ['scene_id', 'pts_semantic_mask'], 'PseudoLabelMetric')
            self.results.append(self._count(fields, _coordinates(data_batch, fields, row), count))

    def score(self, results: list[PseudoLabelCounts]) -> list[ScoreRecord]:
        """The numbers over all scenes; the table goes to the log. Nothing where there was no scene."""
        if not results:
            return []
        names = class_names(self.classes, self.dataset_meta, 'PseudoLabelMetric')
        scores = pseudo_label_scores(reduce(add, results))
        text = format_pseudo_scores(scores, names, self.range_edges or ())
        print_log(f'Pseudo labels (%, metres)\n{text}', logger='current')
        return pseudo_records(scores, names)

    def _count(self, fields: Mapping[str, Any], xyz: np.ndarray | None, count: int) -> PseudoLabelCounts:
        scene = str(fields['scene_id'])
        labels = self.store.read(scene, self.round)
        seen = {name: value for name, value in fields.items() if name != 'annotation'}  # truth of the seen points
        truth = point_truth(seen, len(numpy_of(fields['pts_semantic_mask'])), 'PseudoLabelMetric')
        index = np.arange(len(truth.semantic)) if fields.get('point_index') is None else numpy_of(fields['point_index'])
        if len(index) != len(truth.semantic) or (len(index) and index.max() >= len(labels)):
            raise SceneError(
                f'PseudoLabelMetric: scene {scene}: the sample has {len(truth.semantic)} points that do not fit the '
                f'{len(labels)} points of {self.store.root}; hand on point_index, or label this version of the data'
            )
        votes = fields.get('pred_point_centers')
        return count_pseudo_labels(
            points_of(labels, index),
            SceneTruth(
                truth.semantic,
                truth.instance,
                xyz,
                ranges=None if xyz is None or self.range_edges is None else np.linalg.norm(xyz, axis=1),
            ),
            count,
            self.range_edges or (0.0,),
            voted_centres=None if votes is None else numpy_of(votes),
        )


def points_of(labels: PseudoLabels, index: Int[np.ndarray, ' kept']) -> PseudoLabels:
    """The labels of some points, with all boxes."""
    names = ('semantic', 'instance', 'point_is_annotated', 'confidence', 'likeliest')
    own = {name: rows[index] for name in names if (rows := getattr(labels, name)) is not None}
    return replace(labels, **own)


def _coordinates(batch: Any, fields: Mapping[str, Any], row: int) -> np.ndarray | None:
    """The points of a sample, from itself or from the batch that it came from."""
    points = fields.get('points')
    if points is None and isinstance(batch, Mapping):
        of_batch = (batch.get('inputs') or {}).get('points')
        points = None if of_batch is None else of_batch[row]
    return None if points is None else numpy_of(points)[:, :3].astype(np.float64)


def pseudo_records(scores: PseudoLabelScores, names: Sequence[str]) -> list[ScoreRecord]:
    """The scores of a round, and coverage and precision of each class."""
    metres = (('offset_error', scores.offset_error, 'offset error'), ('vote_error', scores.vote_error, 'vote error'))
    columns = (('coverage', scores.class_coverage), ('precision', scores.class_precision))
    return [
        share('coverage', scores.coverage, 'pseudo labels', 'coverage'),
        share('precision', scores.precision, 'pseudo labels', 'precision'),
        *(
            ScoreRecord(key, None if np.isnan(value) else value, 'pseudo labels', measure, unit='m')
            for key, value, measure in metres
        ),
        *(
            share(f'{key}_{name}', float(value), 'pseudo labels', key, subject=name)
            for key, values in columns
            for name, value in zip(names, values, strict=True)
        ),
    ]


def format_pseudo_scores(scores: PseudoLabelScores, names: Sequence[str], range_edges: Sequence[float] = ()) -> str:
    """A line for each class, each range and the whole."""
    shares = zip(names, scores.class_coverage, scores.class_precision, scores.class_recall, strict=True)
    lines = [
        (name, percent(c), percent(p), percent(r), _metres(offset))
        for (name, c, p, r), offset in zip(shares, scores.class_offset_error, strict=True)
    ]
    ranges = zip(range_edges, scores.range_coverage, scores.range_precision, strict=False)
    lines += [(f'from {low:g} m', percent(c), percent(p), '', '') for low, c, p in ranges]
    whole = ('all', percent(scores.coverage), percent(scores.precision), '', _metres(scores.offset_error))
    return format_columns(('class', 'coverage', 'precision', 'recall', 'offset (m)'), [*lines, whole])


def _metres(value: float) -> str:
    return '-' if np.isnan(value) else f'{value:.3f}'
