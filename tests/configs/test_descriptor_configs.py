"""Configs of learned descriptors build, and their demos change data, sizes and epochs alone."""

import pytest
from configs.leaves import DESCRIPTORS, has_demo
from configs.test_demo_keys import MAY_CHANGE, leaf_keys
from mmengine.config import Config

from rm3d_plugin.datasets import JoinedScenes
from rm3d_plugin.datasets.base import DatasetNotFoundError
from rm3d_plugin.engine.config import load_config
from rm3d_plugin.engine.config_files import shipped_bases
from rm3d_plugin.registry import DATASETS, HOOKS, MODELS
from rm3d_plugin.registry import DESCRIPTORS as PROVIDERS

EACH = pytest.mark.parametrize('path', DESCRIPTORS, ids=lambda path: path.stem)
LABELLED = [path for path in DESCRIPTORS if path.stem.startswith('superpoint')]
PAIRS = [path for path in DESCRIPTORS if path not in LABELLED]
ALSO = {'streets_root', 'more_demo_data'}  # data of the second kind of scenes


@pytest.mark.parametrize('path', LABELLED, ids=lambda path: path.stem)
def test_superpoints_learn_from_the_label_store(path, tmp_path):
    config = load_config(path, tmp_path / 'run')
    network = MODELS.build(config.model)
    assert type(network).__name__ == 'DescriptorNetwork' and list(network.losses) == ['GraphContrast']
    assert type(network.backbone).__name__ == PROVIDERS.get('SupervisedSuperpoint').backbone_type
    dataset = DATASETS.build(config.train_dataloader.dataset)
    assert dataset.labels == 'store' and type(dataset.pipeline[-2]).__name__ == 'ObjectSites'
    assert config.label_maker.instances and config.val_dataloader is None
    assert {hook.type for hook in config.custom_hooks} >= {'RegionMergeHook', 'DescriptorWeightsHook'}


@pytest.mark.parametrize('path', PAIRS, ids=lambda path: path.stem)
def test_a_config_builds_its_network_its_data_and_its_hooks(path, tmp_path):
    config = load_config(path, tmp_path / 'run', options={'data_root': str(tmp_path / 'nothing')})
    network = MODELS.build(config.model)
    kinds = {part.network_type for part in PROVIDERS.module_dict.values() if hasattr(part, 'network_type')}
    assert type(network).__name__ in kinds and len(network.losses) == 1
    dataset = DATASETS.build(config.train_dataloader.dataset)
    assert type(dataset) is JoinedScenes and len(dataset.parts) == (2 if config.data == 'both' else 1)
    assert all(part.labels == 'none' for part in dataset.parts)
    with pytest.raises(DatasetNotFoundError):
        len(dataset)
    assert all(HOOKS.build(hook) for hook in config.custom_hooks)


@pytest.mark.parametrize('path', [path for path in DESCRIPTORS if has_demo(path)], ids=lambda path: path.stem)
def test_a_demo_touches_data_sizes_and_epochs_alone(path, tmp_path):
    with shipped_bases():
        demo = Config.fromfile(path).demo
    assert set(leaf_keys({key: value for key, value in demo.items() if key not in ALSO})) <= MAY_CHANGE
    full, small = load_config(path, tmp_path), load_config(path, tmp_path, demo=True)
    assert full.model == small.model
    assert small.data_root.startswith('data/descriptor_')


@EACH
def test_the_paper_and_other_contrasts_are_options(path, tmp_path):
    config = load_config(path, tmp_path)
    if 'contrast' in config:
        assert config.contrast == 'nce' and config.model.losses[0].contrast == 'nce'
        other = load_config(path, tmp_path, options={'contrast': 'triplet'})
        assert other.model.losses[0].contrast == 'triplet'
