import numpy as np
import pytest

from rm3d_plugin.structures import LabelStatistics

COUNTS = np.array([3, 0])


def test_sizes_may_be_unknown():
    assert LabelStatistics(COUNTS).mean_sizes is None
    assert LabelStatistics(COUNTS, np.array([[4.0, 2, 1], [1, 1, 2]])).mean_sizes[0].tolist() == [4.0, 2.0, 1.0]


@pytest.mark.parametrize(
    ('counts', 'sizes', 'message'),
    [
        (np.array([1, -1]), None, 'expected .C,. from 0'),
        (COUNTS, np.array([[4.0, 2, 1], [1, 0, 2]]), 'expected positive metres'),
        (COUNTS, np.array([[4.0, 2, 1], [1, np.nan, 2]]), 'give None where a class has no size'),
    ],
)
def test_what_cannot_be_is_told(counts, sizes, message):
    with pytest.raises(ValueError, match=message):
        LabelStatistics(counts, sizes)


def test_one_row_of_sizes_a_class():
    with pytest.raises((ValueError, TypeError), match='mean_sizes'):  # the shape check of the tests speaks first
        LabelStatistics(COUNTS, np.ones((3, 3)))
