"""What fusing depth images into a volume does to a surface: layers merge, edges get round, colours run.

A volume of truncated signed distances averages all that was measured within a few voxels. Here each fused point moves
along its normal to the weighted mean of its neighbours, which is the same average without the volume.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from numba import njit

ROUNDS = 1
RUN = 0.3  # share of its neighbours' colour that a point takes in a round
AROUND = 27  # voxels that touch a voxel, itself included


def smooth_surface(
    xyz: Float[np.ndarray, 'points 3'],
    normals: Float[np.ndarray, 'points 3'],
    colors: Float[np.ndarray, 'points 3'],
    weight: Float[np.ndarray, ' points'],
    spacing: float,
) -> tuple[Float[np.ndarray, 'points 3'], Float[np.ndarray, 'points 3'], Float[np.ndarray, 'points 3']]:
    """Positions, normals and colours of fused points after the average.

    Args:
        xyz: Metres, at most one point a voxel of ``spacing``, ordered by voxel (x, then y, then z).
        normals: Unit normals.
        colors: Any scale.
        weight: How often each point was measured.
        spacing: Edge of a voxel, metres.
    """
    low = np.floor(xyz.min(axis=0) / spacing) - 1
    cell = (np.floor(xyz / spacing) - low).astype(np.int64)
    sizes = cell.max(axis=0) + 2
    key = (cell[:, 0] * sizes[1] + cell[:, 1]) * sizes[2] + cell[:, 2]
    order = np.argsort(key, kind='stable')
    near = _neighbours(key[order], order, key, sizes[1], sizes[2])
    xyz, normals, colors = xyz.copy(), normals.copy(), colors.copy()
    for _ in range(ROUNDS):
        xyz, normals, colors = _average(near, xyz, normals, colors, weight, 2.0 * spacing)
    return xyz, normals, colors


@njit(cache=True)
def _neighbours(ordered: Any, order: Any, key: Any, rows: int, columns: int) -> Any:
    """(N, 27) points of the voxels around each point, -1 = none."""
    out = np.full((key.shape[0], AROUND), -1, dtype=np.int32)
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                slot = (dx + 1) * 9 + (dy + 1) * 3 + dz + 1
                shift = (dx * rows + dy) * columns + dz
                at = 0
                for i in range(order.shape[0]):  # keys and shifted keys both ascend: one walk finds all
                    wanted = ordered[i] + shift
                    while at < ordered.shape[0] and ordered[at] < wanted:
                        at += 1
                    if at < ordered.shape[0] and ordered[at] == wanted:
                        out[order[i], slot] = order[at]
    return out


@njit(cache=True)
def _average(near: Any, xyz: Any, normals: Any, colors: Any, weight: Any, reach: float) -> Any:
    """One round: each point takes the mean of those around it, weighted by distance, count and side."""
    moved, turned, mixed = np.empty_like(xyz), np.empty_like(normals), np.empty_like(colors)
    for i in range(xyz.shape[0]):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        total, off = 0.0, 0.0
        sx, sy, sz = 0.0, 0.0, 0.0
        r, g, b = 0.0, 0.0, 0.0
        for k in range(near.shape[1]):
            j = near[i, k]
            if j < 0:
                continue
            dx, dy, dz = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
            close = 1.0 - (dx * dx + dy * dy + dz * dz) / (reach * reach)
            side = nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2]
            if close <= 0.0 or side < -0.5:
                continue
            w = close * close * (1.0 + side) * weight[j]
            total += w
            off += w * (dx * nx + dy * ny + dz * nz)
            sx, sy, sz = sx + w * normals[j, 0], sy + w * normals[j, 1], sz + w * normals[j, 2]
            r, g, b = r + w * colors[j, 0], g + w * colors[j, 1], b + w * colors[j, 2]
        off /= total
        moved[i, 0], moved[i, 1], moved[i, 2] = xyz[i, 0] + off * nx, xyz[i, 1] + off * ny, xyz[i, 2] + off * nz
        length = np.sqrt(sx * sx + sy * sy + sz * sz)
        turned[i, 0], turned[i, 1], turned[i, 2] = sx / length, sy / length, sz / length
        mixed[i, 0] = (1 - RUN) * colors[i, 0] + RUN * r / total
        mixed[i, 1] = (1 - RUN) * colors[i, 1] + RUN * g / total
        mixed[i, 2] = (1 - RUN) * colors[i, 2] + RUN * b / total
    return moved, turned, mixed
