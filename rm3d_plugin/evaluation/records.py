"""What a metric hands on: one record for each number, so that nobody has to take names of scores apart."""

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, final

from mmengine.evaluator import BaseMetric, Evaluator

Table = Literal[
    'points', 'instances', 'segments', 'objects', 'ranges', 'boxes', 'pseudo labels', 'regions', 'agreement'
]
Level = Literal['', 'easy', 'moderate', 'hard']


@dataclass(frozen=True)
class ScoreRecord:
    """One number of a metric.

    Attributes:
        key: Name among the flat scores of ``metrics.json``.
        value: In ``unit``; None where there was nothing to score, and then it is not among the flat scores.
        table: What is scored; 'boxes' by difficulty as KITTI, 'objects' boxes by class alone, 'ranges' by
            distance (among the flat scores only).
        measure: Which number of it: 'IoU', 'AP50', '3d AP R40'.
        subject: Name of the class; '' = of all together.
        variant: Which thresholds, where there are several: '@ 0.70', 'loose'.
        level: Difficulty, where there are several.
        unit: Percent, metres, or '' for a plain number.
        headline: Words for the top of a report; '' = it does not stand there.
        prefix: That of the metric; in the flat scores it stands before the key.
    """

    key: str
    value: float | None
    table: Table
    measure: str
    subject: str = ''
    variant: str = ''
    level: Level = ''
    unit: Literal['%', 'm', ''] = '%'
    headline: str = ''
    prefix: str = ''

    @property
    def number(self) -> float:
        """The value, NaN where there is none."""
        return math.nan if self.value is None else self.value

    @property
    def name(self) -> str:
        """Name among the flat scores, with the prefix."""
        return f'{self.prefix}/{self.key}' if self.prefix else self.key


def share(key: str, part: float, table: Table, measure: str, **more: Any) -> ScoreRecord:
    """The record of a share in [0, 1], in percent; NaN: nothing to score.

    Args:
        key: See :class:`ScoreRecord`.
        part: In [0, 1] or NaN.
        table: See :class:`ScoreRecord`.
        measure: See :class:`ScoreRecord`.
        more: Its other fields.
    """
    return ScoreRecord(key, None if math.isnan(part) else 100 * float(part), table, measure, **more)


class RecordedMetric(BaseMetric):
    """A metric of records; the flat numbers that mmengine logs are their keys and values.

    Attributes:
        records: Of the last evaluation; empty before, and in processes that gather nothing.
    """

    def __init__(self, collect_device: str = 'cpu', prefix: str | None = None) -> None:
        super().__init__(collect_device=collect_device, prefix=prefix)
        self.records: tuple[ScoreRecord, ...] = ()

    @abstractmethod
    def score(self, results: list[Any]) -> Sequence[ScoreRecord]:
        """The numbers over all scenes; tables go to the log. Nothing where there is nothing to say."""

    @final
    def compute_metrics(self, results: list[Any]) -> dict[str, float]:
        """The flat numbers over all scenes."""
        self.records = tuple(replace(record, prefix=self.prefix or '') for record in self.score(results))
        return {record.key: record.value for record in self.records if record.value is not None}


def records_of(evaluator: Evaluator) -> tuple[ScoreRecord, ...]:
    """Records of the last evaluation by all metrics; a metric of another project has none."""
    return tuple(r for metric in evaluator.metrics if isinstance(metric, RecordedMetric) for r in metric.records)


def rows_of(records: Iterable[ScoreRecord]) -> list[dict[str, Any]]:
    """Plain rows for a file."""
    return [asdict(record) for record in records]


def records_from(rows: Iterable[Mapping[str, Any]]) -> tuple[ScoreRecord, ...]:
    """Undo :func:`rows_of`."""
    return tuple(ScoreRecord(**row) for row in rows)
