"""A made-up room: coloured boxes on a grey floor, with the labels of every point."""

import numpy as np
import torch

from rm3d_plugin.structures import SceneSample

COLOURS = np.array([[0.5, 0.5, 0.5], [0.8, 0.2, 0.2], [0.2, 0.3, 0.8]])  # floor, crate, cabinet
SIZES = np.array([[0.4, 0.4, 0.4], [0.5, 0.3, 0.7]])
CLASSES = 3


def surface(center, size, count, rng):
    unit = rng.uniform(-0.5, 0.5, (count, 3))
    unit[np.arange(count), rng.integers(0, 3, count)] = rng.choice([-0.5, 0.5], count)
    return unit * size + center


def make_room(seed, boxes=4, points=250, floor=700, view=False):
    """One item as a data set gives it; boxes stand on a grid, far enough apart to be told from each other."""
    rng = np.random.default_rng(seed)
    xyz = [np.c_[rng.uniform(0, 3, (floor, 2)), rng.normal(0, 0.005, floor)]]
    semantic, instance = [0] * floor, [-1] * floor
    for row, cell in enumerate(rng.permutation(9)[:boxes]):
        kind = row % 2
        center = np.r_[0.5 + cell % 3, 0.5 + cell // 3, SIZES[kind, 2] / 2 + 0.15]  # on legs: no voxel holds floor too
        xyz.append(surface(center, SIZES[kind], points, rng))
        semantic += [kind + 1] * points
        instance += [row * 2 + 5] * points  # numbers with gaps
    semantic = np.array(semantic)
    colour = np.clip(COLOURS[semantic] + rng.normal(0, 0.05, (len(semantic), 3)), 0, 1)
    cloud = torch.tensor(np.c_[np.concatenate(xyz), colour], dtype=torch.float32)
    sample = SceneSample(metainfo={'scene_id': f'room_{seed}', 'num_points': len(cloud)})
    sample.pts_semantic_mask = torch.from_numpy(semantic)
    sample.pts_instance_mask = torch.tensor(instance)
    sample.pts_is_annotated = torch.ones(len(cloud), dtype=torch.bool)
    inputs = {'points': cloud}
    if view:
        rows = torch.from_numpy(np.sort(rng.permutation(len(cloud))[: len(cloud) // 2]))
        mirror = torch.tensor([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
        inputs['views'] = [{'points': cloud[rows] * mirror, 'point_ids': rows}]
    return {'inputs': inputs, 'data_samples': sample}


def segmentor_config(**changes):
    config = dict(
        type='RM3DSegmentor',
        num_classes=CLASSES,
        backbone=dict(type='SparseUNet', voxel_size=0.1, widths=[16, 24, 32], blocks=1),
        instance_head=dict(proposals=dict(radius=0.12, cluster_points=20, min_points=60)),
        thing_classes=[1, 2],
    )
    return {**config, **changes}
