"""Obvious twins of chunks and stitching."""

import numpy as np


def grid_chunks_slow(xyz, size, margin):
    """One chunk a cell that holds points: core rows -> {row: weight}."""
    plane = np.asarray(xyz, dtype=np.float64)[:, :2]
    cells = [tuple(np.floor((point - plane.min(axis=0)) / size)) for point in plane]
    found = {}
    for cell in sorted(set(cells)):
        core = [row for row, other in enumerate(cells) if other == cell]
        low, high = plane[core].min(axis=0), plane[core].max(axis=0)
        weights = {}
        for row, point in enumerate(plane):
            gap = max(0.0, *(low - point), *(point - high))
            if row in core:
                weights[row] = 1.0
            elif gap < margin:
                weights[row] = max(1 - gap / margin, 1e-3)
        found[tuple(core)] = weights
    return found


def stitch_slow(chunks, min_iou):
    """Sets of points, joined step by step: [(points, label, score)] by first part."""
    parts = [
        (number, set(chunk.rows[mask].tolist()), int(label), float(score))
        for number, chunk in enumerate(chunks)
        for mask, label, score in zip(chunk.masks, chunk.labels, chunk.scores, strict=True)
    ]
    group = list(range(len(parts)))
    for i, (chunk_i, mine, label_i, _) in enumerate(parts):
        for j, (chunk_j, other, label_j, _) in enumerate(parts):
            if chunk_i == chunk_j or label_i != label_j:
                continue
            zone = set(chunks[chunk_i].rows.tolist()) & set(chunks[chunk_j].rows.tolist())
            shared, either = mine & other & zone, (mine | other) & zone
            if shared and len(shared) >= min_iou * len(either):
                group = [group[i] if number == group[j] else number for number in group]
    out = []
    for number in dict.fromkeys(group):
        own = [part for part, of in zip(parts, group, strict=True) if of == number]
        sizes = [len(part[1]) for part in own]
        score = sum(part[3] * size for part, size in zip(own, sizes, strict=True)) / sum(sizes)
        out.append((sorted(set.union(*(part[1] for part in own))), own[0][2], score))
    return out
