"""Waymo's AP and APH, slowly: every assignment is tried, every cutoff counted anew, in plain Python."""

import itertools
import math

from rm3d_plugin.ops.boxes import rotated_iou_3d


def best_assignment(overlap, least):
    """Pairs (row, column) with the greatest sum of overlaps in millionths; only pairs that overlap enough."""
    rows, columns = len(overlap), len(overlap[0]) if len(overlap) else 0
    best, chosen = -1, []
    for size in range(min(rows, columns) + 1):
        for some in itertools.combinations(range(rows), size):
            for order in itertools.permutations(range(columns), size):
                pairs = list(zip(some, order, strict=True))
                if all(overlap[r][c] >= least for r, c in pairs):
                    total = sum(round(1_000_000 * overlap[r][c]) for r, c in pairs)
                    if total > best:
                        best, chosen = total, pairs
    return chosen


def waymo_ap_slow(frames, least, level, cutoffs):
    """AP and APH of one class at one level.

    Args:
        frames: (truth boxes, truth levels, found boxes, found scores) of each frame.
        least: Overlap from which a detection hits.
        level: 1 or 2.
        cutoffs: Scores.
    """
    points = []
    for cutoff in cutoffs:
        hits = false = missed = 0
        heading = 0.0
        for boxes, levels, found, scores in frames:
            kept = [i for i in range(len(found)) if scores[i] >= cutoff]
            overlap = rotated_iou_3d(found[kept], boxes).tolist() if kept and len(boxes) else [[] for _ in kept]
            pairs = best_assignment(overlap, least)
            hits += len(pairs)
            false += len(kept) - len(pairs)
            taken = {c for _, c in pairs}
            missed += sum(levels[c] <= level for c in range(len(boxes)) if c not in taken)
            for r, c in pairs:
                apart = abs(found[kept[r]][6] - boxes[c][6]) % (2 * math.pi)
                heading += 1 - min(apart, 2 * math.pi - apart) / math.pi
        recall = hits / (hits + missed) if hits + missed else 0.0
        total = hits + false
        points.append((recall, hits / total if total else 0.0, heading / total if total else 0.0))
    return tuple(_area([(r, p[k] if r else 1.0) for r, *p in points]) for k in (0, 1))


def _area(points):
    """Trapezoids under the greatest precision to the right, with extra samples every .05 of recall in gaps."""
    recalls = sorted({round(r, 9) for r, _ in points} | {0.0})
    height = {r: max([p for q, p in points if round(q, 9) >= r and q > 0], default=0.0) for r in recalls}
    height[0.0] = height[recalls[1]] if len(recalls) > 1 else 1.0
    area = 0.0
    for low, high in zip(recalls, recalls[1:], strict=False):
        # from the right the precision stays that of `high` until the last extra sample; then a slope down to `low`
        steps = 0
        while high - steps * 0.05 - low > 0.05 + 1e-6:
            steps += 1
        turn = high - steps * 0.05
        area += (high - turn) * height[high] + (turn - low) * (height[high] + height[low]) / 2
    return area
