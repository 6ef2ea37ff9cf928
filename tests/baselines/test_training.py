"""Each method learns toy rooms from a few labelled points: every loss takes part, is finite, and labels are learnt."""

import copy
from collections import defaultdict

import numpy as np
import pytest
import torch
from mmengine.logging import MessageHub
from mmengine.registry import DefaultScope
from reference.toy_scenes import ToyRooms

from rm3d_plugin.baselines import BASELINES
from rm3d_plugin.engine.config import load_config
from rm3d_plugin.experiments.run_commands import config_path
from rm3d_plugin.registry import MODELS, SCOPE

EPOCHS = 6
TINY = {
    'num_classes': 3,
    'thing_classes': [1],
    'widths': [8, 16],
    'blocks': 1,
    'voxel_size': 0.2,
    'cluster_radius': 0.2,
    'cluster_points': 5,
    'min_proposal_points': 5,
}
LOSSES = {
    'xu_lee': {'loss_wsl', 'loss_aug', 'loss_inexact', 'loss_smooth'},
    'otoc': {'loss_wsl', 'loss_relation'},
    'psd': {'loss_wsl', 'loss_wsl_view', 'loss_aug', 'loss_relation', 'loss_relation_view'},
    'twist': {'loss_wsl', 'loss_object', 'loss_pseudo', 'loss_pseudo_offset'},
    'erda': {'loss_wsl', 'loss_erda'},
    'cpcm': {'loss_wsl', 'loss_wsl_view', 'loss_masked'},
    'dgnet': {'loss_wsl', 'loss_vmf', 'loss_agreement', 'loss_means'},
    'aadnet': {'loss_wsl'},
}
LATE = {'loss_inexact', 'loss_smooth', 'loss_vmf', 'loss_agreement', 'loss_means'}  # in the second half


@pytest.fixture
def hub(monkeypatch):
    """Tells the epoch."""
    made = MessageHub('test_training')
    made.update_info('max_epochs', EPOCHS)
    monkeypatch.setattr(MessageHub, 'get_current_instance', classmethod(lambda cls: made))
    return made


def batch_of(rooms, index):
    """A room with ten labelled points of each class."""
    item = rooms[index]
    sample, rng = item['data_samples'], np.random.default_rng(index)
    classes = sample.pts_semantic_mask.numpy()
    kept = np.concatenate([rng.permutation(np.flatnonzero(classes == kind))[:10] for kind in range(3)])
    hidden = torch.ones(len(classes), dtype=torch.bool)
    hidden[kept] = False
    sample.pts_semantic_mask[hidden] = -1
    sample.pts_instance_mask[hidden] = -1
    inputs = {key: [value] for key, value in item['inputs'].items() if key != 'views'}
    views = [{key: [value] for key, value in view.items()} for view in item['inputs'].get('views', ())]
    return {'inputs': inputs | {'views': views}, 'data_samples': [sample]}


def learnt(model, rooms, hub) -> dict[str, list[float]]:
    """Every value of every loss."""
    optimizer, said = torch.optim.Adam(model.parameters(), lr=0.01), defaultdict(list)
    for epoch in range(EPOCHS):
        hub.update_info('epoch', epoch)
        if epoch == EPOCHS // 2:
            model.set_teacher(copy.deepcopy(model).eval())
        for index in range(len(rooms)):
            losses = model(**model.data_preprocessor(batch_of(rooms, index), training=True), mode='loss')
            optimizer.zero_grad()
            sum(losses.values()).backward()
            optimizer.step()
            for name, value in losses.items():
                said[name].append(value.item())
    return said


@pytest.mark.parametrize('name', LOSSES)
def test_it_trains(name, hub, tmp_path):
    task = 'ins' if name == 'twist' else 'sem'
    config = load_config(config_path(BASELINES[name].config(task, 'scannet', '0p2pct')), tmp_path, options=TINY)
    torch.manual_seed(0)
    with DefaultScope.overwrite_default_scope(SCOPE):
        model = MODELS.build(config.model).train()
        rooms = ToyRooms(2, 'val', labels='truth', pipeline=config.train_dataloader.dataset.pipeline)
        said = learnt(model, rooms, hub)
    assert LOSSES[name] <= set(said)
    assert all(np.isfinite(values).all() for values in said.values())
    assert np.mean(said['loss_wsl'][-4:]) < 0.8 * np.mean(said['loss_wsl'][:4])
    assert all(len(said[late]) == EPOCHS for late in LATE & set(said))  # two rooms, half of the epochs
