"""Sparse convolution and pooling as written on paper: for every output voxel, look every input voxel up."""

import torch


def neighbours_slowly(coords, targets, offsets, stride):
    """For every offset the (input row, output row) pairs, by a dictionary of coordinates."""
    rows = {tuple(c): i for i, c in enumerate(coords.tolist())}
    found = []
    for offset in offsets:
        wanted = [
            (b, *(s * c + o for s, c, o in zip(stride, cell, offset, strict=True))) for b, *cell in targets.tolist()
        ]
        found.append([(rows[w], j) for j, w in enumerate(wanted) if w in rows])
    return found


def pool_slowly(values, pairs, outputs, reduce):
    members = [[i for offset in pairs for i, j in offset if j == out] for out in range(outputs)]
    pick = (lambda rows: rows.max(0).values) if reduce == 'max' else (lambda rows: rows.mean(0))
    return torch.stack([pick(values[m]) if m else values.new_zeros(values.shape[1]) for m in members])
