"""Networks of descriptors: unit vectors, how far they see, what crops learn of each other."""

import numpy as np
import pytest
import torch

from rm3d_plugin.ops.sites import CHANNELS
from rm3d_plugin.registry import MODELS
from rm3d_plugin.structures import SceneSample

BACKBONE = {'type': 'SparseUNet', 'voxel_size': 1.0, 'widths': [8, 12, 16], 'blocks': 1, 'map_cache': 0}


def make(kind, **settings):
    torch.manual_seed(0)
    return MODELS.build({'type': kind, 'backbone': BACKBONE, 'channels': 16, **settings}).eval()


def surface(seed, side=60):
    """Sites of a wavy square, inputs by chance."""
    rng = np.random.default_rng(seed)
    x, y = (part.ravel() for part in np.meshgrid(np.arange(side), np.arange(side)))
    z = np.round(3 * np.sin(x / 5 + seed) * np.cos(y / 7))
    places = np.stack([x, y, z], axis=1) + 0.5
    return torch.from_numpy(np.c_[places, rng.random((len(places), CHANNELS))].astype(np.float32))


@pytest.fixture(scope='module')
def contrastive():
    return make('DescriptorNetwork', direct=True, losses=[{'type': 'PairContrast'}])


@pytest.fixture(scope='module')
def predator():
    return make('PredatorNetwork', attention={'channels': 16}, losses=[{'type': 'PairCircle'}])


def test_the_reach_is_true_and_tight(contrastive):
    points = surface(0)
    before = contrastive.describe(points, torch.tensor([0, len(points)]))
    changed = points.clone()
    at = 30 * 60 + 30
    changed[at, 3:] += 5.0
    after = contrastive.describe(changed, torch.tensor([0, len(points)]))
    moved = (before - after).abs().amax(1) > 1e-6
    gap = (points[:, :2] - points[at, :2]).abs().amax(1)
    assert moved[at] and gap[moved].max() <= contrastive.reach
    assert gap[moved].max() > contrastive.reach / 2
    torch.testing.assert_close(before.norm(dim=1), torch.ones(len(points)))


@pytest.mark.parametrize('blocks', [1, 2])
def test_the_reach_by_hand(blocks):
    # levels 0 and 1: a stem of 1, blocks of 2 on both sides and a step of 1, then blocks of 4
    net = MODELS.build({**BACKBONE, 'widths': [4, 4], 'blocks': blocks, 'in_channels': CHANNELS})
    assert net.reach == 1 + (4 * blocks + 1) + 4 * blocks


def pair_inputs():
    """Two scans; the view of each is itself backwards, a third of its sites without a copy."""
    scans = [surface(seed, 24) for seed in (0, 1)]
    sizes = torch.tensor([0, *(len(scan) for scan in scans)]).cumsum(0)
    ids = torch.cat(
        [torch.arange(len(scan) - 1, -1, -1) + start for scan, start in zip(scans, sizes[:-1], strict=True)]
    )
    ids[::3] = -1
    view = {'points': torch.cat([scan.flip(0) for scan in scans]), 'batch_offsets': sizes, 'point_ids': ids}
    return {'points': torch.cat(scans), 'batch_offsets': sizes, 'views': [view]}


@pytest.mark.parametrize('kind', ['contrastive', 'predator'])
def test_training_lowers_the_loss(kind, request):
    network = request.getfixturevalue(kind)
    state = {name: value.clone() for name, value in network.state_dict().items()}
    network.train()
    optimizer = torch.optim.Adam(network.parameters(), 5e-3)
    sums = []
    for _ in range(8):
        losses = network(pair_inputs(), [SceneSample(), SceneSample()], 'loss')
        total = sum(value for name, value in losses.items() if 'loss' in name)
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
        sums.append(total.item())
    assert np.isfinite(sums).all() and min(sums[-3:]) < sums[0]
    assert all(value.grad is not None for name, value in network.named_parameters() if 'attention.enter' in name)
    network.load_state_dict(state)
    network.eval()


def test_crops_that_change_places_change_their_answers(predator):
    points, other = surface(0, 20), surface(1, 24)
    offsets = [torch.tensor([0, len(part)]) for part in (points, other)]
    inputs = {'points': points, 'batch_offsets': offsets[0]}
    view = {'points': other, 'batch_offsets': offsets[1], 'point_ids': torch.full((len(other),), -1)}
    swapped = {'points': points, 'batch_offsets': offsets[0], 'point_ids': torch.full((len(points),), -1)}
    one = predator({**inputs, 'views': [view]})
    two = predator({'points': other, 'batch_offsets': offsets[1], 'views': [swapped]})
    torch.testing.assert_close(one.features, two.other.features, atol=1e-5, rtol=0)
    torch.testing.assert_close(one.overlap, two.other.overlap, atol=1e-5, rtol=0)


def test_the_other_crop_is_seen(predator):
    points = surface(0, 20)
    offsets = torch.tensor([0, len(points)])
    alone = predator({'points': points, 'batch_offsets': offsets, 'views': []})
    assert alone.other is None
    view = {'points': surface(3, 20), 'batch_offsets': offsets, 'point_ids': torch.full((len(points),), -1)}
    met = predator({'points': points, 'batch_offsets': offsets, 'views': [view]})
    assert (alone.features - met.features).abs().max() > 1e-4
    torch.testing.assert_close(predator.describe(points, offsets), alone.features)


@pytest.mark.parametrize('kind', ['contrastive', 'predator'])
def test_no_classes_and_no_labels(kind, request):
    network = request.getfixturevalue(kind)
    with pytest.raises(TypeError, match='no classes'):
        network.classify(torch.zeros(2, 3))
    (sample,) = network({'points': surface(0, 10), 'batch_offsets': torch.tensor([0, 100])}, None, 'predict')
    assert sample.pred_descriptors.shape == (100, 16)
