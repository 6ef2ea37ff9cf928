"""The local cloud embedder sees neighbours alone; object sites carry the objects of points."""

import numpy as np
import torch

from rm3d_plugin.datasets.transforms.object_sites import ObjectSites, point_objects
from rm3d_plugin.models.backbones.local_cloud_embedder import LocalCloudEmbedder
from rm3d_plugin.models.descriptors import DescriptorNetwork
from rm3d_plugin.structures import SceneSample


def test_it_sees_as_far_as_it_says():
    torch.manual_seed(0)
    part = LocalCloudEmbedder(2, 8, neighbors=6, radius=1.5).double()
    xyz = torch.rand(150, 3, dtype=torch.float64) * torch.tensor([12.0, 2, 2])
    inputs = torch.randn(150, 2, dtype=torch.float64)
    whole = part(xyz, inputs, torch.tensor([0, 150]))
    seen = (xyz[:, 0] < 4 + part.reach).nonzero()[:, 0]
    alone = part(xyz[seen], inputs[seen], torch.tensor([0, len(seen)]))
    core = xyz[seen, 0] < 4
    torch.testing.assert_close(alone[core], whole[seen][core])
    both = part(torch.cat([xyz, xyz + 50]), torch.cat([inputs, inputs]), torch.tensor([0, 150, 300]))
    torch.testing.assert_close(both[:150], both[150:])


def test_the_turn_begins_as_the_identity_and_leaves_z():
    part = LocalCloudEmbedder(1)
    local = torch.randn(4, 5, 3)
    torch.testing.assert_close(part._turned(local), local)
    torch.nn.init.normal_(part.turn.weight)
    turned = part._turned(local)
    assert not torch.allclose(turned[..., :2], local[..., :2]) and torch.equal(turned[..., 2], local[..., 2])


def test_objects_of_points_and_of_sites():
    assert point_objects(np.array([2, 2, -1, 5, 2]), np.array([0, 1, 3, -1, 0])).tolist() == [0, 1, -1, 2, 0]
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 20, (400, 3)).astype(np.float32)
    xyz[:, 2] = 0
    semantic = (xyz[:, 0] > 10).astype(np.int64)
    given = {
        'points': xyz,
        'semantic': semantic,
        'instance': np.full(400, -1),
        'point_index': np.arange(400),
        'confidence': np.ones(400),
        'scene_id': 'a',
        'num_points': 400,
    }
    out = ObjectSites(2.0)(given)
    assert set(out) == {'scene_id', 'num_points', 'points', 'point_index', 'instance'}
    assert len(out['points']) == len(out['instance']) == len(out['point_index']) < 400
    middle = out['points'][:, 0] - out['points'][:, 0].min()
    assert (out['instance'] == (middle > 4.5)).mean() > 0.9


def test_objects_of_a_batch_are_numbered_through():
    network = DescriptorNetwork({'type': 'LocalCloudEmbedder'}, channels=4, losses=[{'type': 'GraphContrast'}])
    points = [torch.cat([torch.rand(n, 3), torch.rand(n, 7)], dim=1) for n in (3, 2, 4)]
    samples = [SceneSample(), SceneSample(), SceneSample()]
    samples[0].set_data({'pts_instance_mask': torch.tensor([1, -1, 0])})
    samples[2].set_data({'pts_instance_mask': torch.tensor([0, 0, -1, 1])})
    batch = network.join({'points': points})
    found = network.labels(samples, batch, network.network(batch))
    assert found.objects.tolist() == [1, -1, 0, -1, -1, 2, 2, -1, 3]
    assert network({'points': points}, samples, mode='loss')['loss_graph'].item() > 0
