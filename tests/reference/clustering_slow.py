"""Clusters by breadth-first search over all pairs, and suppression with sets."""

from collections import deque

import numpy as np


def slow_clusters(points, radius, groups=None, min_points=1):
    """Cluster of each point, numbered by first points; -1 = none."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    groups = np.zeros(len(points), dtype=int) if groups is None else groups
    out = np.full(len(points), -1)
    seen = groups < 0
    count = 0
    for start in range(len(points)):
        if seen[start]:
            continue
        seen[start] = True
        queue, members = deque([start]), []
        while queue:
            at = queue.popleft()
            members.append(at)
            square = ((points - points[at]) ** 2).sum(axis=1)
            for other in np.flatnonzero((square <= radius * radius) & (groups == groups[at]) & ~seen):
                seen[other] = True
                queue.append(other)
        if len(members) >= min_points:
            out[members] = count
            count += 1
    return out


def slow_mask_nms(masks, scores, iou):
    """Masks as sets; numbers of those that stay, best first."""
    kept = []
    for mask in sorted(range(len(masks)), key=lambda m: (-scores[m], m)):
        overlaps = [len(masks[mask] & masks[k]) / max(len(masks[mask] | masks[k]), 1) for k in kept]
        if all(value <= iou for value in overlaps):
            kept.append(mask)
    return kept
