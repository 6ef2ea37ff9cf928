"""The network's word gives a class only with the confidence asked for it; what truth gave stays."""

import numpy as np
import pytest

from rm3d_plugin.pseudo_labels import ObjectRules
from rm3d_plugin.pseudo_labels.common.groups import GroupLabels, without_doubtful

BACKGROUND = 2
GROUPS = GroupLabels(
    classes=np.array([2, 2, 2, 0, -1]),
    confidence=np.array([0.80, 0.97, 0.60, 0.80, 0.0]),
    from_annotation=np.array([False, False, True, False, False]),
    probabilities=np.full((5, 3), 1 / 3),
)


def test_only_doubtful_background_is_taken_back() -> None:
    out = without_doubtful(GROUPS, np.array([0.0, 0.0, 0.95]))
    assert out.classes.tolist() == [-1, 2, 2, 0, -1]
    assert out.confidence.tolist() == [0.0, 0.97, 0.60, 0.80, 0.0]


def test_above_one_the_network_alone_never_gives_the_class() -> None:
    assert without_doubtful(GROUPS, np.array([0.0, 0.0, 1.1])).classes.tolist() == [-1, -1, 2, 0, -1]


def test_each_class_has_a_limit_of_its_own() -> None:
    assert without_doubtful(GROUPS, np.array([0.9, 0.0, 0.7])).classes.tolist() == [2, 2, 2, -1, -1]


def test_default_asks_no_more_than_gamma() -> None:
    assert ObjectRules().class_gamma is None


def test_out_of_range_rules_are_named() -> None:
    with pytest.raises(ValueError, match=r'ObjectRules\.min_points'):
        ObjectRules(min_points=0)
