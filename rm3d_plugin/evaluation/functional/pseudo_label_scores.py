"""How good pseudo labels are: coverage, precision, offset error (METHOD 9, the paper's Figure 8)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rm3d_plugin.evaluation.functional.pseudo_label_counts import PseudoLabelCounts


@dataclass(frozen=True, eq=False)
class PseudoLabelScores:
    """Shares in [0, 1]; NaN where there is nothing to divide by (the coverage of no points is 0).

    Attributes:
        coverage: Share of all points with a label, annotated ones included.
        precision: Share of the pseudo labels that are correct.
        mean_precision: Mean of ``class_precision`` over the classes that were given.
        class_coverage: (C,) share of a class's hidden points with any pseudo label.
        class_precision: (C,) share of a class's pseudo labels that are correct.
        class_recall: (C,) share of a class's hidden points with the correct pseudo label.
        range_coverage: (B,) coverage of hidden points by distance to the sensor.
        range_precision: (B,) precision by distance.
        range_recall: (B,) recall by distance.
        offset_error: Metres from the pseudo instance's centre to the true one, mean over pseudo-labelled points (see
            :func:`~rm3d_plugin.evaluation.functional.offset_error.offset_error`).
        class_offset_error: (C,) the same by true class.
        vote_error: Metres from the voted centre to the true one, mean over points of true instances.
    """

    coverage: float
    precision: float
    mean_precision: float
    class_coverage: Float[np.ndarray, ' classes']
    class_precision: Float[np.ndarray, ' classes']
    class_recall: Float[np.ndarray, ' classes']
    range_coverage: Float[np.ndarray, ' bins']
    range_precision: Float[np.ndarray, ' bins']
    range_recall: Float[np.ndarray, ' bins']
    offset_error: float
    class_offset_error: Float[np.ndarray, ' classes']
    vote_error: float


def pseudo_label_scores(counts: PseudoLabelCounts) -> PseudoLabelScores:
    """Ratios of summed counts."""
    table, offsets = counts.points, counts.offsets
    by_class = [t.sum(axis=0) for t in (table.present, table.labelled, table.given, table.correct)]
    by_range = [t.sum(axis=1) for t in (table.present, table.labelled, table.given, table.correct)]
    present, labelled, given, correct = by_class
    return PseudoLabelScores(
        coverage=counts.labelled / counts.total if counts.total else 0.0,
        precision=_mean(correct, given),
        mean_precision=mean_of_given(_ratio(correct, given)),
        class_coverage=_ratio(labelled, present),
        class_precision=_ratio(correct, given),
        class_recall=_ratio(correct, present),
        range_coverage=_ratio(by_range[1], by_range[0]),
        range_precision=_ratio(by_range[3], by_range[2]),
        range_recall=_ratio(by_range[3], by_range[0]),
        offset_error=_mean(offsets.metres, offsets.points),
        class_offset_error=_ratio(offsets.metres, offsets.points),
        vote_error=_mean(counts.votes.metres, counts.votes.points),
    )


def _ratio(part: np.ndarray, whole: np.ndarray) -> Float[np.ndarray, ' rows']:
    return np.where(whole > 0, part / np.maximum(whole, 1), np.nan)


def _mean(part: np.ndarray, whole: np.ndarray) -> float:
    return float(part.sum() / whole.sum()) if whole.sum() else float('nan')


def mean_of_given(values: Float[np.ndarray, ' classes']) -> float:
    """Mean of what is not NaN; NaN where nothing is."""
    given = values[~np.isnan(values)]
    return float(given.mean()) if len(given) else float('nan')
