"""Reading the merge ledger: how many pairs merged and why the others did not, in numbers and in words."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from rm3d_plugin.pseudo_labels.common.record import RefreshRecord
from rm3d_plugin.regions import MergeLedger, Reason

_TERMS = {'M_color': 'colour', 'M_scale': 'scale', 'M_des': 'descriptor', 'M_seg': 'semantics'}
_WORDS = {
    Reason.MERGED: 'merged',
    Reason.NOT_CONFIDENT: 'kept apart: one of them is not confident',
    Reason.OTHER_CLASS: 'kept apart: they are of different classes',
    Reason.NOT_SIMILAR: 'kept apart: not similar enough',
    Reason.CENTRES_APART: 'kept apart: their shifted centres are too far from each other',
    Reason.OTHER_INSTANCE: 'kept apart: they belong to two different annotated instances',
    Reason.NOT_REACHED: 'fit to merge, but no seed led there',
    Reason.SAME_GROUP: 'in one group by way of other pairs',
}


class LedgerSummary(NamedTuple):
    """Numbers of one merging step.

    Attributes:
        pairs: Adjacent pairs looked at.
        reasons: How many of them ended for each :class:`Reason`, by its name.
        merged_terms: Mean of each term over the merged pairs; None where it was missing throughout.
    """

    pairs: int
    reasons: dict[str, int]
    merged_terms: dict[str, float | None]


def summarise(ledger: MergeLedger) -> LedgerSummary:
    """Count the reasons, and average the terms of the merged pairs."""
    merged = ledger.select(ledger.accepted)
    terms: dict[str, float | None] = {}
    for name in (*_TERMS, 'S', 'Sbar'):
        values = getattr(merged, name)
        values = values[~np.isnan(values)]
        terms[name] = float(values.mean()) if len(values) else None
    counts = np.bincount(ledger.reason, minlength=len(Reason))
    return LedgerSummary(len(ledger), {r.name: int(counts[r]) for r in Reason}, terms)


def compared_value(ledger: MergeLedger) -> Float[np.ndarray, ' edges']:
    """What was compared with the threshold: S where the rules on record say 'literal', else Sbar."""
    literal = bool(ledger.known) and RefreshRecord.from_arrays(ledger.known).merge.thresholds == 'literal'
    return ledger.S if literal else ledger.Sbar


class Extremes(NamedTuple):
    """Rows of a ledger.

    Attributes:
        strongest: Merged pairs, the largest margin first.
        weakest: Merged pairs, the smallest margin first.
        refused: Pairs refused for being too unlike alone, the nearest to the threshold first.
        margin: (E,) compared value less threshold.
    """

    strongest: Int[np.ndarray, ' rows']
    weakest: Int[np.ndarray, ' rows']
    refused: Int[np.ndarray, ' rows']
    margin: Float[np.ndarray, ' edges']


def extreme_merges(ledger: MergeLedger, count: int) -> Extremes:
    """The strongest and weakest merges and the closest refusals; ties: the earlier row."""
    margin = compared_value(ledger) - ledger.threshold
    merged, refused = np.flatnonzero(ledger.accepted), np.flatnonzero(ledger.reason == Reason.NOT_SIMILAR)
    strong = merged[np.argsort(-margin[merged], kind='stable')]
    weak = merged[np.argsort(margin[merged], kind='stable')]
    near = refused[np.argsort(-margin[refused], kind='stable')]
    return Extremes(strong[:count], weak[:count], near[:count], margin)


def sentence(ledger: MergeLedger, row: int) -> str:
    """What became of one pair, and why."""
    terms = {word: float(getattr(ledger, name)[row]) for name, word in _TERMS.items()}
    known = ', '.join(f'{word} {value:.2f}' for word, value in terms.items() if not np.isnan(value))
    seed = '; the group grows on from there' if ledger.became_seed[row] else ''
    return (
        f'round {ledger.round[row]}: regions {ledger.region_a[row]} and {ledger.region_b[row]} '
        f'{_WORDS[Reason(int(ledger.reason[row]))]} ({known}; S {ledger.S[row]:.2f}, mean {ledger.Sbar[row]:.2f}, '
        f'needed {ledger.threshold[row]:.3f}){seed}'
    )
