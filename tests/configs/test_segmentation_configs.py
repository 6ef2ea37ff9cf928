"""Every config leaf of segmentation builds, with and without --demo; no data are needed for that."""

import inspect
import re
from functools import cache
from pathlib import Path

import pytest
from configs.leaves import SEGMENTATION, has_demo
from mmengine.registry import DefaultScope
from reference.toy_scenes import ToyRooms

from rm3d_plugin.baselines.redal import RegionRoundsSource
from rm3d_plugin.datasets.base import DatasetNotFoundError
from rm3d_plugin.datasets.synthetic import DEMO_SCENES
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.labeling import (
    AnnotatedLabelMaker,
    LabelMaker,
    PointBudgetSource,
    PredictedLabelMaker,
    SegmentationLabelMaker,
)
from rm3d_plugin.labeling.walker import WalkerLabelMaker
from rm3d_plugin.models.segmentors import RM3DSegmentor
from rm3d_plugin.registry import DATASETS, HOOKS, METRICS, MODELS, SCOPE, TASK_UTILS

BUDGETS = ('onept', '20pts', '0p2pct', '1pct')
SEMANTIC, INSTANCES = ('scannet', 's3dis', 'semantickitti', 'semantic3d', 'vkitti'), ('scannet', 's3dis')
EXPECTED = {
    f'{method}_{kind}_{data}_{budget}'
    for kind, sets in (('sem', SEMANTIC), ('ins', INSTANCES))
    for data in sets
    for method, budgets in (('rm3d', BUDGETS), ('sup', (*BUDGETS, 'full')))
    for budget in budgets
}
INSTANCE_METRIC = {'scannet': 'InstanceSegMetric', 's3dis': 'S3DISInstanceMetric'}
EACH = pytest.mark.parametrize('path', SEGMENTATION, ids=lambda path: path.stem)


@pytest.fixture(autouse=True)
def _own_scope():
    with DefaultScope.overwrite_default_scope(SCOPE):
        yield


def load(path: Path, folder: Path, demo: bool = False):
    options = {'data_root': str(folder / 'data'), 'cache_dir': str(folder / 'cache')}
    if 'files' in path.stem:  # found from the scans when training begins
        options['point_columns'] = ['rgb', 'shape', 'place']
    return load_config(path, folder / 'run', demo, options)


_MODELS: dict[str, RM3DSegmentor] = {}


def model_of(config) -> RM3DSegmentor:
    """Many leaves have the same model."""
    key = str(config.model)
    if key not in _MODELS:
        _MODELS[key] = MODELS.build(config.model)
    return _MODELS[key]


@cache
def toy_rooms() -> ToyRooms:
    return ToyRooms(1)


def build_label_maker(config) -> LabelMaker:
    """The label maker of a config, on toy rooms."""
    hook = next(hook for hook in config.custom_hooks if hook.type == 'RegionMergeHook')
    assert (hook.interval, hook.rounds) == (config.sigma, config.label_refreshes)
    with pytest.raises(DatasetNotFoundError):  # the source of the config is well-formed: it looks for its data
        HOOKS.build(hook)
    source = dict(hook.label_maker.source)
    kind = TASK_UTILS.get(source.pop('type'))
    assert kind is (RegionRoundsSource if config.config_name.startswith('redal_') else PointBudgetSource)
    assert source.pop('dataset') == config.label_dataloader.dataset
    return TASK_UTILS.build({**hook.label_maker, 'source': kind(toy_rooms(), **source)})


def test_every_data_set_has_every_budget():
    assert {path.stem for path in SEGMENTATION} >= EXPECTED


@EACH
@pytest.mark.parametrize('demo', [False, True], ids=['', 'demo'])
def test_everything_a_leaf_names_can_be_built(path, demo, tmp_path):
    if demo and not has_demo(path):
        with pytest.raises(ConfigError, match='this config has no `demo` settings'):
            load(path, tmp_path, demo)
        return
    config = load(path, tmp_path, demo)
    assert '${' not in str(config.to_dict())
    model, instances = model_of(config), '_ins_' in path.stem
    assert type(model) is RM3DSegmentor and (model.instance_head is not None) == instances
    for name in ('train_dataloader', 'label_dataloader', 'val_dataloader', 'test_dataloader'):
        dataset = DATASETS.build(config[name].dataset)
        assert len(dataset.classes) == model.num_classes == config.num_classes
        assert dataset.metainfo['thing_classes'] == model.thing_classes
        with pytest.raises(DatasetNotFoundError):
            len(dataset)
    assert (config.train_dataloader.dataset.labels, config.label_dataloader.dataset.labels) == ('store', 'none')
    data_set, budget = re.split('_(?:sem|ins)_', path.stem)[1].split('_')[0], path.stem.split('_')[-1]
    kinds = ['SemSegMetric', *([INSTANCE_METRIC[data_set]] if instances else [])]
    assert [type(METRICS.build(metric)).__name__ for metric in config.val_evaluator] == kinds
    assert config.test_evaluator == config.val_evaluator
    assert [step.max_points for step in config.train_pipeline if 'Crop' in step.type] == [config.crop_points]
    assert config.budget == ({'clicks': 'clicks.csv'} if budget == 'clicks' else budget)
    ours = SegmentationLabelMaker if config.get('walker') is None else WalkerLabelMaker
    if config.label_maker.get('predicted'):
        made = PredictedLabelMaker
    else:
        made = ours if config.propagate else AnnotatedLabelMaker
    assert type(build_label_maker(config)) is made
    periods = config.param_scheduler[0].get('periods')
    assert periods is None or sum(periods) == config.epochs
    if demo:
        settings = dict(config.demo_data)
        inspect.signature(DEMO_SCENES[settings.pop('scenes')]).bind('root', **settings)


@EACH
def test_references_keep_their_first_labels_and_learn_no_offset_from_few_points(path, tmp_path):
    config = load(path, tmp_path)
    grows = config.label_maker.source.type == 'RegionRoundsSource'
    if config.propagate or config.label_maker.get('predicted') or grows:
        assert config.label_refreshes == config.rounds and not path.stem.startswith('sup_')
        return
    assert config.label_refreshes == 1 and not config.propagate
    if '_ins_' in path.stem and path.stem.startswith('sup_'):
        model, full = model_of(config), path.stem.endswith('full')
        offsets = model.losses['InstanceOffsets']
        taught = offsets.loss.loss_weight > 0
        assert taught == path.stem.endswith(('full', '1pct')) and ('InstanceDice' in model.losses) == full
        assert model.instance_head.rules.coordinates == ('both' if taught else 'original')
        assert offsets.min_points == (10 if path.stem.endswith('1pct') else 1)
