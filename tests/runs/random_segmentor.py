"""A segmentor with random weights in a checkpoint as runs write them, and a scan for it."""

import json

import numpy as np
import torch
from mmengine.registry import DefaultScope

import rm3d_plugin.models  # noqa: F401  (registers its parts)
from rm3d_plugin.registry import MODELS, SCOPE
from rm3d_plugin.storage.ply import write_ply

NAMES = ('ground', 'tree', 'house')


def make_checkpoint(path, classes=NAMES, columns=('rgb',), instances=False, pipeline=(), named=None, **dataset):
    """A network with random weights, stored as a run stores it."""
    model = dict(
        type='RM3DSegmentor',
        num_classes=len(classes),
        inputs=dict(columns=list(columns)),
        backbone=dict(type='SparseUNet', voxel_size=0.3, widths=[8, 12], blocks=1),
        thing_classes=list(range(len(classes))) if instances else [],
    )
    if instances:
        model['instance_head'] = dict(type='PointGroupHead', proposals=dict(radius=0.6, cluster_points=3, min_points=3))
    data = dict(type='FilesDataset', classes=list(classes), pipeline=[*pipeline, dict(type='PackScene')], **dataset)
    if named is not None:
        data['columns'] = named
    config = dict(model=model, val_dataloader=dict(dataset=data))
    torch.manual_seed(0)
    with DefaultScope.overwrite_default_scope(SCOPE):
        weights = MODELS.build(model).state_dict()
    torch.save({'meta': {'config_json': json.dumps(config)}, 'state_dict': weights}, path)
    return path


def make_scan(path, count=300, shift=(0.0, 0.0, 0.0), seed=0, color=True):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 5, (count, 3)) + shift
    columns = {axis: xyz[:, i] for i, axis in enumerate('xyz')}
    if color:
        columns |= {axis: rng.integers(0, 256, count).astype(np.uint8) for axis in ('red', 'green', 'blue')}
    return write_ply(path, columns)
