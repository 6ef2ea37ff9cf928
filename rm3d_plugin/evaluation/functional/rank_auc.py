"""Area under the ROC curve of a single value, from ranks."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import rankdata


def rank_auc(values: Float[np.ndarray, ' items'], positive: Bool[np.ndarray, ' items']) -> float:
    """How often a positive item has the larger value than a negative one; ties count half (Mann and Whitney 1947).

    Args:
        values: One value an item.
        positive: Which items are positive.

    Returns:
        In [0, 1]; 0.5 = the value says nothing; NaN where one of the two groups is empty.

    >>> rank_auc(np.array([1.0, 2.0, 3.0]), np.array([False, False, True]))
    1.0
    """
    count = int(positive.sum())
    others = len(positive) - count
    if count == 0 or others == 0:
        return float('nan')
    rank_sum = float(rankdata(values)[positive].sum())
    return (rank_sum - count * (count + 1) / 2) / (count * others)
