"""The ledger of merges, counted and in words."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels.common.ledger import sentence, summarise
from rm3d_plugin.regions import MergeLedger, Reason


def ledger():
    return MergeLedger(
        region_a=np.array([0, 0]),
        region_b=np.array([1, 2]),
        M_color=np.array([np.nan, np.nan]),
        M_scale=np.array([0.5, 1.0]),
        M_des=np.array([0.75, 0.25]),
        M_seg=np.array([1.0, 0.5]),
        A_n=np.array([1.0, 0.25]),
        A_des=np.array([0.5, 0.25]),
        S=np.array([1.5, 1.0]),
        Sbar=np.array([0.75, 0.5]),
        threshold=np.array([0.625, 0.625]),
        accepted=np.array([True, False]),
        became_seed=np.array([True, False]),
        round=np.array([4, 4]),
        reason=np.array([Reason.MERGED, Reason.NOT_SIMILAR]),
    )


def test_the_ledger_counts_and_explains():
    summary = summarise(ledger())
    assert summary.pairs == 2
    assert {k: v for k, v in summary.reasons.items() if v} == {'MERGED': 1, 'NOT_SIMILAR': 1}
    assert summary.merged_terms == {
        'M_color': None, 'M_scale': 0.5, 'M_des': 0.75, 'M_seg': 1.0, 'S': 1.5, 'Sbar': 0.75,
    }  # fmt: skip
    assert sentence(ledger(), 1) == (
        'round 4: regions 0 and 2 kept apart: not similar enough '
        '(scale 1.00, descriptor 0.25, semantics 0.50; S 1.00, mean 0.50, needed 0.625)'
    )
    assert sentence(ledger(), 0).endswith('needed 0.625); the group grows on from there')


def test_columns_must_fit():
    arrays = ledger().to_arrays() | {'S': np.zeros(3)}
    with pytest.raises(ValueError, match=r'MergeLedger\.S: expected 2 rows, got 3'):
        MergeLedger.from_arrays(arrays)
