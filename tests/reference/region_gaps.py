"""Gaps between regions from all pairs of points."""

import numpy as np


def gaps(xyz, labels, max_gap):
    """{(i, j): smallest distance}, i < j, up to ``max_gap``."""
    distance = np.linalg.norm(xyz[:, None].astype(float) - xyz[None].astype(float), axis=2)
    out = {}
    for i in range(labels.max() + 1):
        for j in range(i + 1, labels.max() + 1):
            gap = distance[np.ix_(labels == i, labels == j)].min()
            if gap <= max_gap:
                out[i, j] = gap
    return out


def keep_nearest(found, neighbors):
    """Edges that either end has among its nearest."""
    kept = set()
    for region in {r for pair in found for r in pair}:
        mine = sorted((gap, sum(pair) - region, pair) for pair, gap in found.items() if region in pair)
        kept.update(pair for _, _, pair in mine[:neighbors])
    return sorted(kept)
