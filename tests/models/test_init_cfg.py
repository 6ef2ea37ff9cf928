"""Backbones and heads start as mmengine's ``init_cfg`` says; without one they start as before."""

import pytest
import torch
from mmengine.model import BaseModule

from rm3d_plugin.registry import MODELS

PARTS = {
    'SparseUNet': dict(in_channels=3, voxel_size=0.1, widths=(4, 8), blocks=1),
    'SemanticHead': dict(in_channels=4, num_classes=2),
    'PointGroupHead': dict(in_channels=4),
    'VoteHead': dict(in_channels=4, num_classes=2, hidden=8),
    'SceneClassHead': dict(num_classes=2),
}


@pytest.mark.parametrize('kind', PARTS)
def test_weights_start_as_they_are_told(kind):
    torch.manual_seed(0)
    plain = MODELS.build(dict(type=kind, **PARTS[kind]))
    torch.manual_seed(0)
    layer = ['SparseConv', 'InverseConv'] if kind == 'SparseUNet' else 'Linear'
    told = MODELS.build(dict(type=kind, **PARTS[kind], init_cfg=dict(type='Constant', layer=layer, val=0.25, bias=0.0)))
    assert isinstance(plain, BaseModule)
    assert all(torch.equal(a, b) for a, b in zip(plain.parameters(), told.parameters(), strict=True))
    before = [value.clone() for value in plain.parameters()]
    plain.init_weights()
    told.init_weights()
    assert all(torch.equal(a, b) for a, b in zip(plain.parameters(), before, strict=True))
    weights = [value for name, value in told.named_parameters() if name.endswith('weight') and value.ndim > 1]
    assert weights and all(bool((value == 0.25).all()) for value in weights)
