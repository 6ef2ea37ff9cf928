"""The sparse U-Net: shapes, ragged batches, determinism, learning."""

import pytest
import torch

from rm3d_plugin.models.backbones import SparseUNet
from rm3d_plugin.models.backbones.layers import InverseConv, NormReLU, SparseConv, SparseFeatures
from rm3d_plugin.ops.kernel_map import VoxelLevel
from rm3d_plugin.ops.voxelize import voxelize
from rm3d_plugin.registry import MODELS


def room(points, seed=0):
    generator = torch.Generator().manual_seed(seed)
    xyz = torch.rand(points, 3, generator=generator) * torch.tensor([2.0, 2.0, 1.0])
    walls = torch.randint(0, 3, (points,), generator=generator)
    xyz[torch.arange(points), walls] *= 0.02
    return xyz, torch.rand(points, 3, generator=generator)


def network(**change):
    torch.manual_seed(0)
    config = dict(type='SparseUNet', in_channels=3, voxel_size=0.1, widths=(8, 12, 16), blocks=1) | change
    return MODELS.build(config)


def test_points_of_a_voxel_share_their_features():
    net, (xyz, features) = network(), room(500)
    out = net(xyz, features, torch.tensor([0, 200, 500]))
    assert out.shape == (500, net.out_channels) and net.out_channels == 8
    voxels = voxelize(xyz, features, torch.tensor([0, 200, 500]), 0.1)
    first = torch.zeros(len(voxels.coords), dtype=torch.int64).scatter_(
        0, voxels.point_to_voxel.flip(0), torch.arange(499, -1, -1)
    )
    assert torch.equal(out, out[first][voxels.point_to_voxel])


def test_scenes_of_a_batch_do_not_meet():
    net = network().eval()
    a, b = room(300, 1), room(200, 2)
    both = net(torch.cat([a[0], b[0]]), torch.cat([a[1], b[1]]), torch.tensor([0, 300, 500]))
    alone = [net(*scene, torch.tensor([0, len(scene[0])])) for scene in (a, b)]
    assert torch.equal(both, torch.cat(alone))


def test_order_of_points_does_not_matter():
    net, (xyz, features) = network(reduce='mean').eval(), room(400)
    order = torch.randperm(400, generator=torch.Generator().manual_seed(3))
    offsets = torch.tensor([0, 400])
    permuted = net(xyz[order], features[order], offsets)
    torch.testing.assert_close(permuted, net(xyz, features, offsets)[order], atol=1e-5, rtol=1e-5)


def test_moving_by_whole_coarse_cells_moves_the_features_along():
    net, (xyz, features) = network(voxel_size=0.125).eval(), room(400)
    offsets = torch.tensor([0, 400])
    moved = net(xyz + 5 * 0.5, features, offsets)  # 0.5 m = 4 voxels = one cell of the coarsest of three levels
    torch.testing.assert_close(moved, net(xyz, features, offsets), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize(('points', 'offsets'), [(1, [0, 1]), (1, [0, 0, 1, 1]), (2, [0, 1, 2]), (5, [0, 0, 5])])
@pytest.mark.parametrize('training', [True, False])
def test_tiny_and_empty_scenes(points, offsets, training):
    net, (xyz, features) = network().train(training), room(points)
    out = net(xyz, features, torch.tensor(offsets))
    out.sum().backward()
    assert out.shape == (points, 8) and bool(out.isfinite().all())


def test_a_batch_without_points_is_an_error():
    with pytest.raises(ValueError, match='without any point'):
        network()(torch.zeros(0, 3), torch.zeros(0, 3), torch.tensor([0, 0, 0]))


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (dict(preset='huge'), 'large.*paper.*small'),
        (dict(widths=()), 'widths'),
        (dict(blocks=0), 'blocks'),
        (dict(voxel_size=0.0), 'voxel_size'),
    ],
)
def test_bad_settings_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        SparseUNet(**(dict(in_channels=3, voxel_size=0.1) | change))


def test_presets():
    small = SparseUNet(3, 0.1, preset='small')
    assert small.out_channels == 16
    paper, xyz = SparseUNet(3, 0.1, preset='paper'), room(200)
    assert paper(*xyz, torch.tensor([0, 200])).shape == (200, 16)
    assert SparseUNet(3, 0.1, preset='large', blocks=1).out_channels == 32


def test_checkpointing_changes_nothing():
    (xyz, features), offsets = room(300), torch.tensor([0, 300])
    results = []
    for checkpointing in (False, True):
        net = network(checkpointing=checkpointing)
        out = net(xyz, features, offsets)
        out.square().sum().backward()
        results.append([out.detach(), *[p.grad for p in net.parameters()], *[b.clone() for b in net.buffers()]])
    for plain, again in zip(*results, strict=True):
        assert torch.equal(plain, again)


def test_same_bits_for_every_number_of_threads():
    (xyz, features), offsets = room(20000), torch.tensor([0, 9000, 20000])
    results = []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            net = network(voxel_size=0.03)
            out = net(xyz, features, offsets)
            out.square().mean().backward()
            results.append([out.detach(), *[p.grad for p in net.parameters()], *net.buffers()])
    finally:
        torch.set_num_threads(1)
    assert all(torch.equal(one, two) for one, two in zip(*results, strict=True))


def test_autocast_keeps_the_convolutions_in_single_precision():
    net, (xyz, features) = network(), room(300)
    with torch.autocast('cpu', dtype=torch.bfloat16):
        out = net(xyz, features.bfloat16(), torch.tensor([0, 300]))
    out.float().sum().backward()
    assert out.dtype == torch.float32 and all(bool(p.grad.isfinite().all()) for p in net.parameters())


def test_second_derivatives_are_refused():
    net, (xyz, features) = network(), room(50)
    out = net(xyz, features.requires_grad_(), torch.tensor([0, 50]))
    (grad,) = torch.autograd.grad(out.square().sum(), features, create_graph=True)
    with pytest.raises(RuntimeError, match='once_differentiable'):
        grad.sum().backward()


def test_learns_where_a_point_lies():
    xyz, offsets = room(600)[0], torch.tensor([0, 600])
    net = network()
    head = torch.nn.Linear(net.out_channels, 2)
    target = (xyz[:, 0] > xyz[:, 1]).long()
    optimizer = torch.optim.Adam([*net.parameters(), *head.parameters()], lr=0.02)
    losses = []
    for _ in range(25):
        loss = torch.nn.functional.cross_entropy(head(net(xyz, xyz, offsets)), target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.25 < losses[0]


def test_norm_relu_keeps_torchs_running_statistics():
    torch.manual_seed(0)
    x = torch.randn(50, 4) * 3 + 1
    own, theirs = NormReLU(4, 1e-4, 0.1), torch.nn.BatchNorm1d(4, eps=1e-4, momentum=0.1)
    torch.testing.assert_close(own(x), theirs(x).relu(), atol=1e-5, rtol=1e-5)
    for name, buffer in own.norm.named_buffers():
        torch.testing.assert_close(buffer, dict(theirs.named_buffers())[name])
    torch.testing.assert_close(own.eval()(x), theirs.eval()(x).relu(), atol=1e-5, rtol=1e-5)


def test_one_voxel_in_training_uses_and_keeps_the_running_statistics():
    norm, x = NormReLU(3, 1e-4, 0.1), torch.tensor([[2.0, -1.0, 0.5]])
    before = [b.clone() for b in norm.buffers()]
    torch.testing.assert_close(norm(x), x.relu(), atol=1e-3, rtol=1e-3)
    assert all(torch.equal(a, b) for a, b in zip(before, norm.buffers(), strict=True))


def test_inverse_returns_to_the_finer_voxels():
    level = VoxelLevel(torch.tensor([[0, -3, 0, 1], [0, 0, 0, 0], [0, 0, 0, 1], [1, 0, 0, 0]]))
    down, up = SparseConv(2, 3, kernel_size=2, stride=2, bias=True), InverseConv(3, 2, bias=True)
    coarse = down(SparseFeatures(torch.randn(4, 2), level))
    assert coarse.level.coords.tolist() == [[0, -2, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]]
    fine = up(coarse, level)
    assert fine.level is level
    picks = [(0, 0b101), (1, 0b000), (1, 0b001), (2, 0b000)]  # coarse row and offset (x, y, z) of each voxel
    wanted = torch.stack([coarse.values[row] @ up.weight[k] for row, k in picks])
    torch.testing.assert_close(fine.values, wanted)
