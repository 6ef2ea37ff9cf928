"""What a config leaves open is found in the scans, said, and the rest is checked before any geometry."""

import numpy as np
import pytest
from mmengine.config import Config
from mmengine.registry import DefaultScope

from rm3d_plugin.datasets import FilesDataset
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.found_inputs import (
    find_inputs,
    inner_range,
    intensity_range,
    sensed,
    shared_channels,
    take_inputs,
)
from rm3d_plugin.registry import DATASETS, SCOPE
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.structures import PointCloud, SceneError

XYZ = np.random.default_rng(0).uniform(0, 5, (200, 3)).astype(np.float32)
STRENGTH = np.arange(200, dtype=np.float32) * 10


@pytest.fixture(autouse=True)
def _own_scope():
    with DefaultScope.overwrite_default_scope(SCOPE):
        yield


def write(folder, name, colors=False, intensity=None):
    columns = {axis: XYZ[:, i] for i, axis in enumerate('xyz')}
    if colors:
        columns |= dict.fromkeys(('red', 'green', 'blue'), np.full(200, 7, dtype=np.uint8))
    if intensity is not None:
        columns['intensity'] = intensity
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / f'{name}.ply', columns)


def config_of(folder, **options) -> Config:
    return load_config(
        'rm3d_sem_files_streets_clicks', folder / 'run', options={'data_root': str(folder), 'cache_dir': None} | options
    )


@pytest.mark.parametrize(
    ('colors', 'intensity', 'expected'),
    [
        (False, None, []),
        (True, None, ['rgb']),
        (False, STRENGTH, ['intensity']),
        (True, STRENGTH, ['intensity', 'rgb']),
    ],
)
def test_columns_are_those_of_the_scans(colors, intensity, expected, tmp_path, capsys):
    write(tmp_path, 'a', colors, intensity)
    config = config_of(tmp_path)
    find_inputs(config)
    assert config.model.inputs.columns == config.point_columns == [*expected, 'shape', 'place']
    assert f'point_columns: {", ".join([*expected, "shape", "place"])}; in 1 scans' in capsys.readouterr().out
    item = DATASETS.build({**config.label_dataloader.dataset, 'pipeline': []})[0]
    assert item['points'].shape[1] == 3 + sum({'intensity': 1, 'rgb': 3}[name] for name in expected)
    if 'intensity' in expected:
        assert config.intensity_range == pytest.approx([0, np.percentile(STRENGTH, 99.9)])
        assert (item['points'][:, 3].min(), item['points'][:, 3].max()) == (0, 1)


def test_what_some_scans_lack_is_left_out_and_said(tmp_path, capsys):
    write(tmp_path, 'a', colors=True, intensity=STRENGTH)
    write(tmp_path, 'b', colors=True)
    config = config_of(tmp_path)
    find_inputs(config)
    assert config.point_columns == ['rgb', 'shape', 'place'] and config.intensity_range is None
    assert 'in 2 scans; intensity is left out, since b has none' in capsys.readouterr().out
    hook = next(hook for hook in config.custom_hooks if hook.type == 'RegionMergeHook')
    for dataset in (config.train_dataloader.dataset, config.val_dataloader.dataset, hook.dataloader.dataset):
        assert dataset.channels == ['rgb']
    items = DATASETS.build({**config.label_dataloader.dataset, 'pipeline': []})
    assert [item['points'].shape[1] for item in items] == [6, 6]


def test_scans_that_are_only_scored_count_too(tmp_path):
    write(tmp_path / 'train', 'a', colors=True)
    write(tmp_path / 'val', 'a')
    config = config_of(tmp_path)
    find_inputs(config)
    assert config.point_columns == ['shape', 'place']


def test_named_columns_are_checked(tmp_path):
    write(tmp_path, 'a', colors=True, intensity=STRENGTH)
    config = config_of(tmp_path, point_columns=['rgb', 'shape', 'place'])
    find_inputs(config)
    assert config.val_dataloader.dataset.channels == ['rgb'] and config.intensity_range is None
    write(tmp_path, 'b')
    with pytest.raises(SceneError, match=r"scene b: has no colour, but point_columns=\['rgb', 'shape', 'place'\] asks"):
        find_inputs(config_of(tmp_path, point_columns=['rgb', 'shape', 'place']))
    with pytest.raises(ConfigError, match=r"eval_pipeline appends \['shape', 'place'\] to the points"):
        find_inputs(config_of(tmp_path, point_columns=['shape']))


def test_labels_that_scores_need_are_read_before_anything_is_computed(tmp_path):
    write(tmp_path, 'a', colors=True)
    options = {'class_names': ['red', 'green'], 'columns': {'label': 'red'}, 'val_labels': 'truth'}
    with pytest.raises(SceneError, match=r'a\.ply: label: expected one of \[1\], got 7; map it'):
        find_inputs(config_of(tmp_path, **options, label_map={1: 'red'}))
    find_inputs(config_of(tmp_path, **options, label_map={7: 'red'}))


def test_a_checkpoint_says_how_scans_are_read(tmp_path):
    write(tmp_path, 'a', colors=True, intensity=STRENGTH)
    write(tmp_path, 'b', intensity=STRENGTH)
    trained = config_of(tmp_path)
    find_inputs(trained)
    other = config_of(tmp_path)
    take_inputs(other, trained.to_dict())
    assert other.model.inputs.columns == ['intensity', 'shape', 'place']
    for name in ('channels', 'intensity_range'):
        assert other.val_dataloader.dataset[name] == trained.val_dataloader.dataset[name]


def test_intensities_become_fractions_whatever_the_sensor_counts():
    odd = np.r_[np.linspace(-2048, 2047, 10_000), 65535.0]  # one mirror
    low, high = inner_range(odd)
    assert -2048 <= low < -2040 and 2040 < high <= 2047.5
    cloud = PointCloud(np.zeros((len(odd), 3)), intensity=odd.astype(np.float32))
    scans = [sensed('a', cloud), sensed('b', PointCloud(XYZ, intensity=STRENGTH))]
    assert intensity_range(scans) == pytest.approx((low, high)) and shared_channels(scans) == ['intensity']
    assert intensity_range([sensed('c', PointCloud(XYZ, intensity=STRENGTH / 2000))]) is None
    assert intensity_range([sensed('d', PointCloud(XYZ))]) is None


def test_items_lack_nothing_that_was_asked_for(tmp_path):
    write(tmp_path, 'a')
    with pytest.raises(SceneError, match=r'scene a: has no rgb; take it out of `channels`'):
        _ = FilesDataset(tmp_path, channels=['rgb'], cache=None)[0]
    with pytest.raises(ValueError, match='channels: expected one of intensity, rgb, got .colour'):
        FilesDataset(tmp_path, channels=['colour'])


def test_pairs_and_numbers_are_intensity_ranges(tmp_path):
    write(tmp_path, 'a', intensity=STRENGTH - 500)
    for given, low, high in (([-500, 500], -500, 500), (1000, 0, 1000)):
        read = FilesDataset(tmp_path, intensity_range=given, cache=None).load_cloud(0).intensity
        np.testing.assert_allclose(read, np.clip((STRENGTH - 500 - low) / (high - low), 0, 1), atol=1e-6)
    with pytest.raises(ValueError, match='intensity_range: expected a number > 0, or a pair LOW < HIGH'):
        FilesDataset(tmp_path, intensity_range=[5, 5])
