"""Whole models on a GPU: losses, gradients and predictions of the CPU; skipped where there is no CUDA."""

import copy

import pytest
import torch
from mmengine.dataset import pseudo_collate
from models.segmentors.coloured_boxes import make_room, segmentor_config

from rm3d_plugin.ops._backends import has_spconv
from rm3d_plugin.registry import MODELS

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason='no CUDA device')
BACKENDS = [
    'ours',
    pytest.param('spconv', marks=pytest.mark.skipif(not has_spconv(), reason='spconv is not installed')),
]


def losses_and_gradients(model, items):
    losses = model(**model.data_preprocessor(pseudo_collate(items), True), mode='loss')
    total, values = model.parse_losses(losses)
    total.backward()
    gradients = torch.cat([p.grad.flatten().cpu() for p in model.parameters() if p.grad is not None])
    return {name: float(value) for name, value in values.items()}, gradients


def assert_same_step(model, make_items):
    other = copy.deepcopy(model).cuda()
    wanted, gradient = losses_and_gradients(model, make_items())
    got, other_gradient = losses_and_gradients(other, make_items())
    assert got == pytest.approx(wanted, rel=1e-3, abs=1e-5)
    assert float((other_gradient - gradient).norm() / gradient.norm()) < 1e-2


@pytest.mark.filterwarnings('ignore')
@pytest.mark.parametrize('backend', BACKENDS)
def test_a_step_of_the_instance_segmentor(backend):
    torch.manual_seed(0)
    config = segmentor_config()
    config['backbone']['backend'] = 'ours'
    model = MODELS.build(config)
    other_config = copy.deepcopy(config)
    other_config['backbone']['backend'] = backend
    other = MODELS.build(other_config)
    other.load_state_dict(model.state_dict())
    make_items = lambda: [make_room(seed, view=True) for seed in range(2)]  # noqa: E731
    wanted, gradient = losses_and_gradients(model, make_items())
    got, other_gradient = losses_and_gradients(other.cuda(), make_items())
    assert got == pytest.approx(wanted, rel=1e-3, abs=1e-5)
    assert float((other_gradient - gradient).norm() / gradient.norm()) < 1e-2


def test_a_step_of_the_detector(world):
    torch.manual_seed(0)
    config = world.config(backbone=dict(type='SparseUNet', voxel_size=0.3, widths=[8, 16], blocks=1))
    assert_same_step(MODELS.build(config), lambda: [world.make_scene(seed, classes=(0, 1, 2)) for seed in range(2)])


def test_predictions_of_the_segmentor():
    torch.manual_seed(0)
    model = MODELS.build(segmentor_config())
    other = copy.deepcopy(model).cuda()
    batches = [pseudo_collate([make_room(seed) for seed in range(2)]) for _ in range(2)]
    with torch.no_grad():
        wanted = model.eval()(**model.data_preprocessor(batches[0]), mode='predict')
        got = other.eval()(**other.data_preprocessor(batches[1]), mode='predict')
    for one, two in zip(wanted, got, strict=True):
        torch.testing.assert_close(two.pred_point_probs.cpu(), one.pred_point_probs, atol=1e-4, rtol=1e-3)
        torch.testing.assert_close(two.pred_point_centers.cpu(), one.pred_point_centers, atol=1e-4, rtol=1e-3)
