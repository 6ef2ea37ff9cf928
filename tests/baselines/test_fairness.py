"""Every compared method sees what the others see: the same drawn labels and no others, scenes, steps and network.

The audit trains each method twice, the second time with noise in every hidden label: not a bit may change.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from mmengine.config import config as config_text
from mmengine.registry import DefaultScope
from reference.toy_scenes import CLASSES, ToyRooms

from rm3d_plugin.baselines import COMBINATIONS, LABELLED_ONLY, METHODS, REFERENCES
from rm3d_plugin.engine.config import load_config
from rm3d_plugin.engine.screen import QuietRunner
from rm3d_plugin.experiments.run_commands import config_path
from rm3d_plugin.label_budgets import load_point_budget, scramble_hidden_points
from rm3d_plugin.labeling import PointBudgetSource
from rm3d_plugin.registry import DATASETS, SCOPE

VIEWS = ('AugmentedView', 'MaskedView')
LEARNERS = [each for each in METHODS if set(each.options) & {'sem', 'ins'}]
EACH = pytest.mark.parametrize('method', LEARNERS, ids=[each.name for each in LEARNERS])
TINY = {
    'dataset_type': 'AuditRooms',
    'num_classes': len(CLASSES),
    'thing_classes': [1],
    'voxel_size': 0.2,
    'widths': [8, 12],
    'blocks': 1,
    'crop_points': 1500,
    'descriptor.radius': 0.3,  # m; toy rooms are thin
    'batch_size': 1,
    'budget': '20pts',
    'rounds': 2,
    'sigma': 1,
    'cluster_radius': 0.15,
    'cluster_points': 10,
    'min_proposal_points': 10,
    'threads': 1,
}


def task_of(method):
    return 'sem' if 'sem' in method.options else 'ins'


def leaf(method, demo=True):
    return load_config(config_path(method.config(task_of(method), 'scannet', '0p2pct')), 'run', demo)


class AuditRooms(ToyRooms):
    """One toy room; ``noise``, a budget, hides all that it does not show."""

    noise, grows = None, False

    def __init__(self, data_root: Any = None, **settings: Any) -> None:
        super().__init__(count=1, **settings)

    def load_truth(self, index: int) -> Any:
        truth = super().load_truth(index)
        if self.noise is None:
            return truth
        rows = self.noise.annotated[self.scene_ids[index]].points
        if self.grows:  # who asks for labels learns where there are none
            rows = np.union1d(rows, np.flatnonzero(truth.semantic < 0))
        return scramble_hidden_points(truth, rows, np.random.default_rng([7, index]))


@pytest.fixture(scope='module')
def shown():
    """The labels that a seed draws for everybody."""
    return PointBudgetSource(ToyRooms(1), TINY['budget'], 0).budget


@pytest.fixture
def world(monkeypatch):
    DATASETS.register_module(module=AuditRooms, force=True)
    monkeypatch.setattr(config_text, 'FormatCode', lambda text, **_: (text, True))  # costs more than the training
    with DefaultScope.overwrite_default_scope(SCOPE):
        yield monkeypatch


def train(method, folder: Path, geometry: Path):
    config = load_config(
        config_path(method.config(task_of(method), 'scannet', '0p2pct')),
        folder,
        demo=True,
        options={**TINY, 'cache_dir': str(geometry)},
    )
    for hook in config.custom_hooks:
        if hook.type == 'PretrainingHook':
            hook.cache = str(folder / 'pretrained')  # each run pays for itself
    config.custom_hooks = [hook for hook in config.custom_hooks if hook.type != 'ReportHook']
    for name in ('val_dataloader', 'val_evaluator', 'val_cfg', 'test_dataloader', 'test_evaluator', 'test_cfg'):
        config[name] = None
    config.experiment_name = f'{method.name}_{folder.name}'
    config.log_level = 'ERROR'
    QuietRunner.from_cfg(config).train()
    state = torch.load(folder / 'epoch_2.pth', weights_only=True)['state_dict']
    budget = load_point_budget(folder / 'labels' / 'budget.json')
    return json.loads((folder / 'metrics.json').read_text())['losses'], state, budget


@pytest.fixture(scope='module')
def geometry(tmp_path_factory):
    return tmp_path_factory.mktemp('geometry')


@EACH
def test_noise_in_hidden_labels_changes_no_bit(method, tmp_path, geometry, shown, world):
    losses, state, budget = train(method, tmp_path / 'true', geometry)
    grows = 'budget grows' in method.declares
    world.setattr(AuditRooms, 'noise', budget)
    world.setattr(AuditRooms, 'grows', grows)
    world.setattr(PointBudgetSource, '_make', lambda self: shown)  # noise would be drawn otherwise
    noisy_losses, noisy_state, noisy_budget = train(method, tmp_path / 'noisy', geometry)
    assert losses == noisy_losses and len(losses) == 2
    assert all(np.isfinite(list(epoch.values())).all() for epoch in losses.values())
    assert state.keys() == noisy_state.keys()
    assert [name for name in state if not torch.equal(state[name], noisy_state[name])] == []
    assert budget.hash == noisy_budget.hash
    assert budget.hash == shown.hash or (grows and budget.annotated_count == shown.annotated_count)


@EACH
def test_network_and_schedule_are_those_of_rm3d(method):
    theirs = leaf(method)
    ours = load_config(config_path(f'rm3d_{task_of(method)}_scannet_0p2pct'), 'run', demo=True)
    assert theirs.model.backbone == ours.model.backbone and theirs.model.semantic_head == ours.model.semantic_head
    for key in ('optim_wrapper', 'param_scheduler', 'rounds', 'sigma', 'train_cfg'):
        assert theirs[key] == ours[key], key


@EACH
def test_steps_and_points_are_those_of_rm3d(method):
    theirs, ours = (
        config.train_dataloader
        for config in (
            leaf(method),
            load_config(config_path(f'rm3d_{task_of(method)}_scannet_0p2pct'), 'run', demo=True),
        )
    )

    def first_view(loader):
        return [step for step in loader.dataset.pipeline if step.type not in VIEWS]

    assert (theirs.batch_size, theirs.sampler) == (ours.batch_size, ours.sampler)
    assert first_view(theirs) == first_view(ours) or 'label-aware sampling' in method.declares
    whole = [{**loader.dataset, 'pipeline': None} for loader in (theirs, ours)]
    assert whole[0] == whole[1]


@EACH
def test_the_budget_is_that_of_all(method):
    theirs = leaf(method)
    ours = load_config(config_path(f'rm3d_{task_of(method)}_scannet_0p2pct'), 'run', demo=True)
    sources = [
        hook.label_maker.source for config in (theirs, ours) for hook in config.custom_hooks if 'label_maker' in hook
    ]
    assert len(sources) == 2
    assert sources[0] == sources[1] or 'budget grows' in method.declares


@EACH
def test_no_class_tags(method):
    """No loss of the classes of whole scenes, which would need tags from the hidden truth."""
    kinds = {loss.type for loss in leaf(method).model.losses if loss is not None}
    assert 'SceneClasses' not in kinds


def test_extra_costs_are_declared():
    for method in METHODS:
        hook = next(iter(method.options.values())).get('method_hook') or {}
        assert (hook.get('type') == 'PretrainingHook') == ('pre-training' in method.declares), method.name


def test_every_method_is_compared():
    names = {each.name for each in (*METHODS, *REFERENCES)}
    assert LABELLED_ONLY.name in names and {both.name for both in COMBINATIONS} <= names
    assert len(names) == len(METHODS) + len(REFERENCES)
