"""Configs of learned descriptors build, and their demos change data, sizes and epochs alone."""

import pytest
from configs.leaves import DESCRIPTORS, LEAVES, has_demo
from configs.test_demo_keys import MAY_CHANGE, leaf_keys
from mmengine.config import Config

from rm3d_plugin.datasets import JoinedScenes
from rm3d_plugin.datasets.base import DatasetNotFoundError
from rm3d_plugin.engine.config import load_config
from rm3d_plugin.engine.config_files import shipped_bases
from rm3d_plugin.experiments.benchmarks.propagate_clicks import ROOM_SEED
from rm3d_plugin.experiments.scenes import SEED
from rm3d_plugin.registry import DATASETS, HOOKS, MODELS
from rm3d_plugin.registry import DESCRIPTORS as PROVIDERS

EACH = pytest.mark.parametrize('path', DESCRIPTORS, ids=lambda path: path.stem)
LABELLED = [path for path in DESCRIPTORS if path.stem.startswith('superpoint')]
CLASSES = [path for path in DESCRIPTORS if path.stem.startswith('semantic')]
PAIRS = [path for path in DESCRIPTORS if path not in LABELLED + CLASSES]
ALSO = {'streets_root', 'stations_root', 'frames_root', 'more_demo_data'}  # data of further kinds of scenes


def demo_data(path, work_dir):
    """Settings of the made-up scenes of a demo."""
    config = load_config(path, work_dir / path.stem, demo=True)
    return [config.demo_data, *config.get('more_demo_data', [])]


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


@pytest.mark.parametrize('path', CLASSES, ids=lambda path: path.stem)
def test_each_data_set_has_a_block_of_classes(path, tmp_path):
    config = load_config(path, tmp_path / 'run')
    network = MODELS.build(config.model)
    assert type(network).__name__ == PROVIDERS.get('Semantic').network_type and list(network.losses) == ['SiteClasses']
    assert config.model.in_channels == PROVIDERS.get('Semantic').in_channels
    dataset = DATASETS.build(config.train_dataloader.dataset)
    assert isinstance(dataset, JoinedScenes)
    counts = [len(part.classes) for part in dataset.parts]
    assert list(config.site_classes) == counts and network.losses['SiteClasses'].layer.out_features == sum(counts)
    steps = [part.pipeline[0] for part in dataset.parts]
    assert [step.first_class for step in steps] == [sum(counts[:number]) for number in range(len(counts))]
    assert all(type(part.pipeline[-2]).__name__ == 'ClassSites' for part in dataset.parts)


def test_scenes_whose_labels_taught_the_package_are_in_no_other_demo(tmp_path):
    taught = {item.seed for path in CLASSES for item in demo_data(path, tmp_path)}
    others = {item.get('seed', 0) for path in LEAVES if has_demo(path) for item in demo_data(path, tmp_path)}
    assert taught and not taught & (others | {SEED, ROOM_SEED})


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
