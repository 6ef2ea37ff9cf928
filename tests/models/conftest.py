"""A made-up world for the model tests: boxes with points on their faces, above a floor."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import nn

from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import SceneSample

SIZES = [[4.0, 1.8, 1.5], [0.8, 0.6, 1.7], [1.8, 0.6, 1.7]]


@MODELS.register_module(name='PointNetStandIn', force=True)
class PointNetStandIn(nn.Module):
    """Every point sees itself and the mean of its 2 m cells: enough of a backbone for a tiny world."""

    def __init__(self, out_channels: int = 32, in_channels: int = 4) -> None:
        super().__init__()
        self.out_channels = out_channels
        self.first = nn.Sequential(
            nn.Linear(in_channels + 3, out_channels), nn.ReLU(), nn.Linear(out_channels, out_channels)
        )
        self.second = nn.Sequential(nn.Linear(2 * out_channels, out_channels), nn.LayerNorm(out_channels), nn.ReLU())

    def forward(self, xyz, features, batch_offsets):
        scene = torch.arange(len(batch_offsets) - 1).repeat_interleave(batch_offsets.diff())
        hidden = self.first(torch.cat([xyz / 5.0, features], dim=1)).float()
        cells = torch.cat([scene[:, None], (xyz[:, :2] / 2.0).floor().long()], dim=1)
        _, inverse = torch.unique(cells, dim=0, return_inverse=True)
        count = int(inverse.max()) + 1 if len(inverse) else 0
        total = torch.zeros(count, hidden.shape[1]).index_add(0, inverse, hidden)
        mean = total / torch.bincount(inverse, minlength=count).clamp_min(1)[:, None]
        return self.second(torch.cat([hidden, mean[inverse]], dim=1))


def box_surface(box, count, rng):
    """Points on the faces of a box, slightly inside."""
    unit = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    unit[np.arange(count), axis] = 0.49 * rng.choice([-1.0, 1.0], count)
    local = unit * box[3:6]
    c, s = np.cos(box[6]), np.sin(box[6])
    turned = np.c_[local[:, 0] * c - local[:, 1] * s, local[:, 0] * s + local[:, 1] * c, local[:, 2]]
    return turned + box[:3]


def make_scene(seed, classes=(0, 1, 2, 0), floor=300, view=False):
    """One item as a data set gives it: objects on a circle, every label known."""
    rng = np.random.default_rng(seed)
    boxes, points, semantic, instance = [], [], [], []
    for row, kind in enumerate(classes):
        angle = 2 * np.pi * row / len(classes) + rng.uniform(-0.2, 0.2)
        size = np.array(SIZES[kind]) * rng.uniform(0.9, 1.1, 3)
        box = np.r_[6 * np.cos(angle), 6 * np.sin(angle), size[2] / 2 - 1.7, size, rng.uniform(-np.pi, np.pi)]
        boxes.append(box)
        points.append(box_surface(box, 80, rng))
        semantic += [kind] * 80
        instance += [row] * 80
    points.append(np.c_[rng.uniform(-9, 9, (floor, 2)), np.full(floor, -1.75)])
    semantic += [3] * floor
    instance += [-1] * floor
    xyz = np.concatenate(points)
    cloud = torch.tensor(np.c_[xyz, rng.uniform(0, 1, len(xyz))], dtype=torch.float32)
    sample = SceneSample(metainfo={'scene_id': f'made_{seed}', 'num_points': len(cloud)})
    sample.gt_bboxes_3d = torch.tensor(np.array(boxes).reshape(-1, 7), dtype=torch.float32)
    sample.gt_labels_3d = torch.tensor(list(classes), dtype=torch.int64)
    sample.gt_is_annotated = torch.ones(len(classes), dtype=torch.bool)
    sample.pts_semantic_mask = torch.tensor(semantic)
    sample.pts_instance_mask = torch.tensor(instance)
    inputs = {'points': cloud}
    if view:
        rows = torch.from_numpy(rng.permutation(len(cloud))[: len(cloud) // 2])
        inputs['views'] = [{'points': cloud[rows] * torch.tensor([1.0, -1.0, 1.0, 1.0]), 'point_ids': rows}]
    return {'inputs': inputs, 'data_samples': sample}


def detector_config(**changes):
    head = dict(
        mean_sizes=SIZES, heading_bins=12, num_seeds=128, num_proposals=32, hidden=48, radius=1.2, near=0.8, far=1.6
    )
    head.update(changes.pop('head', {}))
    config = dict(type='RM3DVoteNet', backbone=dict(type='PointNetStandIn'), num_classes=3, vote_head=head)
    return {**config, **changes}


@pytest.fixture
def world():
    return SimpleNamespace(make_scene=make_scene, config=detector_config, sizes=SIZES)
