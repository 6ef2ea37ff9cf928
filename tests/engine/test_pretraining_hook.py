"""The backbone learns once, from the scans alone; an interrupted pre-training ends as another does."""

import logging
from types import SimpleNamespace

import pytest
import torch
from mmengine.config import Config
from mmengine.registry import DefaultScope
from mmengine.runner import Runner
from reference.toy_scenes import ToyRooms

from rm3d_plugin.engine.config_files import ConfigError
from rm3d_plugin.engine.hooks import PretrainingHook, pretraining_hook
from rm3d_plugin.engine.hooks.pretraining_hook import crop_pipeline
from rm3d_plugin.models.pretraining import Pretraining
from rm3d_plugin.registry import DATASETS, MODELS, SCOPE
from rm3d_plugin.storage import read_json

LOSS = dict(type='PointContrast', in_channels=8, voxel_size=0.2, pairs=200)
PIPELINE = [dict(type='RandomCrop', max_points=900), dict(type='AugmentedView', prob=0.1), dict(type='PackScene')]


@pytest.fixture(autouse=True)
def _toy_rooms():
    DATASETS.register_module(module=ToyRooms, force=True)
    with DefaultScope.overwrite_default_scope(SCOPE):
        yield


def runner_in(folder, seed, epoch=0):
    config = Config(
        dict(
            model=dict(
                type='RM3DSegmentor',
                num_classes=3,
                backbone=dict(type='SparseUNet', voxel_size=0.2, widths=[8, 12], blocks=1),
            ),
            train_dataloader=dict(
                batch_size=2,
                dataset=dict(type='ToyRooms', count=2, labels='store', label_store='nowhere', pipeline=PIPELINE),
            ),
            optim_wrapper=dict(type='OptimWrapper', optimizer=dict(type='Adam', lr=0.01)),
        )
    )
    torch.manual_seed(seed)
    return SimpleNamespace(
        cfg=config, model=MODELS.build(config.model), work_dir=str(folder / f'run{seed}'), epoch=epoch, max_epochs=2,
        logger=logging.getLogger('test'), build_dataloader=Runner.build_dataloader,
    )  # fmt: skip


def learn(folder, seed=0, cache='cache', **where):
    runner = runner_in(folder, seed, **where)
    before = {name: value.clone() for name, value in runner.model.state_dict().items()}
    PretrainingHook(LOSS, str(folder / cache)).before_train(runner)
    return before, runner.model.state_dict(), runner


def test_runs_of_other_seeds_share_what_was_learnt(tmp_path, monkeypatch):
    before, after, runner = learn(tmp_path, seed=0)
    changed = {name for name in before if not torch.equal(before[name], after[name])}
    assert changed and all(name.startswith('backbone.') for name in changed)
    record = read_json(f'{runner.work_dir}/pretraining.json')
    assert record['epochs'] == 2 and record['cpu_seconds'] > 0
    monkeypatch.setattr(pretraining_hook, 'one_epoch', None)  # not called again
    _, other, second = learn(tmp_path, seed=1)
    for name in after:
        assert torch.equal(after[name], other[name]) == name.startswith(('backbone.', 'semantic_head.class_counts')), (
            name
        )
    assert read_json(f'{second.work_dir}/pretraining.json') == record


def test_the_run_draws_the_same_numbers_as_without(tmp_path):
    torch.manual_seed(5)
    expected = torch.rand(3)
    runner = runner_in(tmp_path, 0)
    torch.manual_seed(5)
    PretrainingHook(LOSS, str(tmp_path / 'cache'), epochs=1).before_train(runner)
    assert torch.equal(torch.rand(3), expected)


def test_an_interrupted_pretraining_goes_on(tmp_path, monkeypatch):
    _, whole, _ = learn(tmp_path, cache='whole')
    one_epoch = pretraining_hook.one_epoch

    def killed(school, epoch):
        if epoch == 1:
            raise KeyboardInterrupt
        return one_epoch(school, epoch)

    monkeypatch.setattr(pretraining_hook, 'one_epoch', killed)
    with pytest.raises(KeyboardInterrupt):
        learn(tmp_path, cache='broken')
    monkeypatch.setattr(pretraining_hook, 'one_epoch', one_epoch)
    _, resumed, _ = learn(tmp_path, cache='broken')
    assert all(torch.equal(whole[name], resumed[name]) for name in whole)


def test_a_resumed_run_keeps_its_weights(tmp_path):
    before, after, _ = learn(tmp_path, epoch=1)
    assert all(torch.equal(before[name], after[name]) for name in before)


def test_the_pipeline_of_training_with_crops():
    paste = dict(type='LabelledObjectPaste', max_objects=3)
    made = crop_pipeline([paste, *PIPELINE], dict(type='OverlappingCrops'))
    assert [step['type'] for step in made] == ['RandomCrop', 'OverlappingCrops', 'PackScene']
    with pytest.raises(ConfigError, match='expected AugmentedView'):
        crop_pipeline([dict(type='PackScene')], {})


def test_a_loss_of_labels_is_refused(tmp_path):
    config = runner_in(tmp_path, 0).cfg.model
    with pytest.raises(ValueError, match='WeakSupervision reads logits, semantic'):
        Pretraining(MODELS.build({**config, 'losses': [dict(type='WeakSupervision')]}))
