"""SHOT of one point written as METHOD 3 reads: every bin's share of every neighbour, float64."""

import numpy as np


def slow_frame(offsets, radius):
    """Rows x, y, z; ``offsets``: neighbours minus the centre, nearest first."""
    distances = np.linalg.norm(offsets, axis=1)
    weights = radius - distances
    matrix = sum(w * np.outer(d, d) for w, d in zip(weights, offsets, strict=True)) / weights.sum()
    vectors = np.linalg.eigh(matrix)[1].T
    axes = []
    for axis in (vectors[2], vectors[0]):
        ahead = (offsets @ axis >= 0).sum()
        if 2 * ahead == len(offsets):
            middle = len(offsets) // 2
            ahead, total = (offsets[middle - 2 : middle + 3] @ axis > 0).sum(), 5
        else:
            total = len(offsets)
        axes.append(axis if 2 * ahead > total else -axis)
    return np.stack([axes[0], np.cross(axes[1], axes[0]), axes[1]])


def shares(position, cells, around=False):
    """Bin centres 0 to cells - 1: the bin that holds a position with 1 - r, the next nearest with r."""
    own = int(np.clip(np.floor(position + 0.5), 0, cells - 1))
    rest = position - own
    other = own + (1 if rest > 0 else -1)
    found = {own: 1 - abs(rest)}
    if around or 0 <= other < cells:
        found[other % cells] = abs(rest)
    return own, found


def slow_shot(offsets, normals, radius, frame):
    """(352,) unnormalised signature."""
    histogram = np.zeros((8, 2, 2, 11))
    for offset, normal in zip(offsets, normals, strict=True):
        x, y, z = frame @ offset
        distance = np.linalg.norm(offset)
        sector, sectors = shares((np.arctan2(y, x) + np.pi) / (np.pi / 4) - 0.5, 8, around=True)
        shell, shells = shares((distance - radius / 4) / (radius / 2), 2)
        half, halves = shares((np.radians(135) - np.arccos(np.clip(z / distance, -1, 1))) / (np.pi / 2), 2)
        position = 5 * (1 + np.clip(normal @ frame[2], -1, 1))
        step = int(np.floor(position + 0.5))
        for other, share in sectors.items():
            histogram[other, shell, half, step] += share
        for other, share in shells.items():
            histogram[sector, other, half, step] += share
        for other, share in halves.items():
            histogram[sector, shell, other, step] += share
        rest = position - step
        histogram[sector, shell, half, step] += 1 - abs(rest)
        histogram[sector, shell, half, (step + (1 if rest > 0 else -1)) % 10] += abs(rest)
    return histogram.reshape(-1)
