"""Boundary scores with sets of edges."""

import numpy as np


def slow_boundary(xyz, classes, regions, k=5, objects=None):
    """Recall and precision with a tolerance of one edge, by looking at every pair of edges."""
    objects = classes if objects is None else objects
    edges = set()
    for i in range(len(xyz)):
        distance = [
            (float(((xyz[i].astype(float) - p) ** 2).sum()), j) for j, p in enumerate(xyz.astype(float)) if j != i
        ]
        edges |= {tuple(sorted((i, j))) for _, j in sorted(distance)[:k]}
    edges = [e for e in edges if all(classes[v] not in (-1, 255) for v in e)]
    true = [e for e in edges if objects[e[0]] != objects[e[1]]]
    found = [e for e in edges if regions[e[0]] != regions[e[1]]]
    recalled = sum(any(set(e) & set(f) for f in found) for e in true)
    confirmed = sum(any(set(e) & set(f) for f in true) for e in found)
    return recalled / len(true) if true else 1.0, confirmed / len(found) if found else 1.0


def slow_oracle_iou(classes, regions, num_classes):
    given = np.full(len(classes), -1)
    for region in set(regions.tolist()) - {-1}:
        votes = [int(((regions == region) & (classes == c)).sum()) for c in range(num_classes)]
        given[regions == region] = int(np.argmax(votes))
    known = (classes >= 0) & (classes != 255)
    out = []
    for c in range(num_classes):
        a, b = known & (classes == c), known & (given == c)
        out.append((a & b).sum() / (a | b).sum() if a.any() else np.nan)
    return np.array(out)
