"""Voxels by a dictionary, one point after the other."""

import torch


def voxelize_slowly(points, features, batch_offsets, voxel_size, reduce):
    cells = {}
    for scene in range(len(batch_offsets) - 1):
        for i in range(int(batch_offsets[scene]), int(batch_offsets[scene + 1])):
            cell = [int(v) for v in torch.floor(points[i].double() / voxel_size)]
            cells.setdefault((scene, *cell), []).append(i)
    order = sorted(cells)
    rows = [features[cells[c]].mean(0) if reduce == 'mean' else features[cells[c][0]] for c in order]
    point_to_voxel = [0] * len(points)
    for row, cell in enumerate(order):
        for i in cells[cell]:
            point_to_voxel[i] = row
    return torch.stack(rows), [list(c) for c in order], point_to_voxel
