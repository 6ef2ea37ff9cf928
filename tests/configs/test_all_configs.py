"""Every config leaf of detection builds, with and without --demo; no data are needed for that."""

import pytest
from configs.leaves import DETECTION
from mmengine.registry import DefaultScope

from rm3d_plugin.datasets import InstanceBoxDataset, KittiDataset, WaymoDataset
from rm3d_plugin.datasets.base import DatasetNotFoundError
from rm3d_plugin.engine.config import load_config
from rm3d_plugin.engine.hooks import EpochSeedHook, RegionMergeHook, RunRecordHook, SafeCheckpointHook
from rm3d_plugin.evaluation import IndoorDetMetric, KittiMetric, WaymoMetric
from rm3d_plugin.models.detectors import RM3DVoteNet
from rm3d_plugin.registry import DATASETS, DESCRIPTORS, HOOKS, METRICS, MODELS, OVERSEGMENTERS, SCOPE
from rm3d_plugin.reporting import ReportHook

DATA = {
    'kitti': (KittiDataset, KittiMetric, 'KITTI was looked for at'),
    'waymo': (WaymoDataset, WaymoMetric, 'Waymo was looked for at'),
    'scannet': (InstanceBoxDataset, IndoorDetMetric, 'ScanNet was looked for at'),
    's3dis': (InstanceBoxDataset, IndoorDetMetric, 'S3DIS'),
}
MEASURED = [path for path in DETECTION if 'files' in path.stem]  # tests/engine/test_measured.py
FIXED = [path for path in DETECTION if path not in MEASURED]


@pytest.fixture(autouse=True)
def _own_scope():
    with DefaultScope.overwrite_default_scope(SCOPE):
        yield


def test_there_are_leaves():
    three = [f'rm3d_votenet_{data}_{budget}' for data in DATA for budget in ('0p5pct', '1pct', '3pct')]
    assert {*three, 'rm3d_votenet_scannet_onebox', 'rm3d_votenet_files_boxes'} <= {path.stem for path in DETECTION}


@pytest.mark.parametrize('path', FIXED, ids=lambda path: path.stem)
@pytest.mark.parametrize('demo', [False, True], ids=['', 'demo'])
def test_everything_a_config_names_can_be_built(path, demo, tmp_path):
    config = load_config(path, tmp_path / 'run', demo, {'data_root': str(tmp_path / 'kitti')})
    assert '${' not in str(config.to_dict())
    model = MODELS.build(config.model)
    dataset_type, metric, missing = next(kinds for name, kinds in DATA.items() if name in path.stem)
    assert type(model) is RM3DVoteNet and model.num_classes == len(config.classes) == len(config.class_sizes)
    assert model.backbone.voxel_size == config.voxel_size
    for name in ('train_dataloader', 'label_dataloader', 'val_dataloader', 'test_dataloader'):
        dataset = DATASETS.build(config[name].dataset)
        assert type(dataset) is dataset_type and dataset.data_root == tmp_path / 'kitti'
        with pytest.raises(DatasetNotFoundError, match=missing):
            len(dataset)
    assert config.train_dataloader.dataset.labels == 'store' and config.label_dataloader.dataset.labels == 'none'
    assert config.train_dataloader.dataset.label_store == f'{tmp_path / "run"}/labels'
    for evaluator in (config.val_evaluator, config.test_evaluator):
        assert type(METRICS.build(evaluator[0])) is metric
    assert config.train_cfg == {
        'type': 'RoundTrainLoop',
        'rounds': config.rounds,
        'sigma': config.sigma,
        'val_rounds': config.val_rounds,
    }
    assert DESCRIPTORS.build(config.descriptor) and OVERSEGMENTERS.build(config.oversegmenter)


@pytest.mark.parametrize('path', FIXED, ids=lambda path: path.stem)
def test_the_hooks_of_a_config(path, tmp_path):
    config = load_config(path, tmp_path / 'run', demo=True, options={'data_root': str(tmp_path / 'kitti')})
    kinds = {'RegionMergeHook': RegionMergeHook, 'EpochSeedHook': EpochSeedHook, 'ReportHook': ReportHook}
    kinds |= {'RunRecordHook': RunRecordHook, 'SafeCheckpointHook': SafeCheckpointHook}
    if config.method_hook is not None:  # of a compared method
        kinds[config.method_hook.type] = HOOKS.get(config.method_hook.type)
    assert sorted(hook.type for hook in config.custom_hooks) == sorted(kinds)
    for settings in config.custom_hooks:
        if settings.type != 'RegionMergeHook':
            assert type(HOOKS.build(settings)) is kinds[settings.type]
            continue
        assert (settings.interval, settings.rounds) == (config.sigma, config.label_refreshes)
        assert (
            settings.label_maker.source.budget == config.budget and settings.label_maker.descriptor == config.descriptor
        )
        with pytest.raises(DatasetNotFoundError):  # the type and the words survive the registry
            HOOKS.build(settings)
