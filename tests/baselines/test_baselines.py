"""Each baseline is described, and its configs differ from RM3D's in what its spec says, and in nothing else."""

import pytest
from configs.leaves import LEAVES, SEGMENTATION

from rm3d_plugin.baselines import BASELINES, COMBINATIONS, FULL_SUPERVISION, LABELLED_ONLY, METHODS
from rm3d_plugin.engine.config import load_config
from rm3d_plugin.experiments.run_commands import config_path

METHODS_OF_FOLDER = [path for path in LEAVES if path.parent.name == 'baselines' and '\nmethod_' in path.read_text()]
MEASURED = {'sem': ('scannet', '0p2pct'), 'ins': ('scannet', '0p2pct'), 'votenet': ('kitti', '1pct')}


@pytest.mark.parametrize('baseline', BASELINES.values(), ids=list(BASELINES))
def test_the_readme_says_what_it_is(baseline):
    text = baseline.readme.read_text()
    for part in ('**What it is.**', '**Source.**', '**What differs from RM3D.**', '**Labels.**', 'rm3d train'):
        assert part in text
    for options in baseline.options.values():
        assert all(f'`{key} = {value!r}`' in text for key, value in options.items())


def test_names():
    assert LABELLED_ONLY.config('sem', 'scannet', '0p2pct') == 'sup_sem_scannet_0p2pct'
    assert FULL_SUPERVISION.config('votenet', 'kitti', '1pct') == 'sup_votenet_kitti_full'
    assert [LABELLED_ONLY.row('ins'), FULL_SUPERVISION.row('votenet')] == ['labelled points alone', 'all boxes']


@pytest.mark.parametrize('demo', [False, True])
@pytest.mark.parametrize(
    ('baseline', 'task', 'data', 'budget'),
    [
        (LABELLED_ONLY, 'sem', 'scannet', '0p2pct'),
        (LABELLED_ONLY, 'ins', 'scannet', '0p2pct'),
        (LABELLED_ONLY, 'sem', 'oakland', '1pct'),
        (LABELLED_ONLY, 'votenet', 'kitti', '1pct'),
        (FULL_SUPERVISION, 'sem', 'semantickitti', '1pct'),
        (FULL_SUPERVISION, 'ins', 'scannet', '0p2pct'),
        (FULL_SUPERVISION, 'votenet', 'kitti', '1pct'),
        *((each, task, *MEASURED[task]) for each in METHODS for task in each.options),
        *((each, 'sem', 'scannet', '0p2pct') for each in COMBINATIONS),
    ],
)
def test_the_config_is_that_of_rm3d_with_the_options(tmp_path, baseline, task, data, budget, demo):
    if demo and data == 'oakland':
        pytest.skip('real data alone')
    options = baseline.options[task]
    ours = load_config(config_path(f'rm3d_{task}_{data}_{budget}'), tmp_path, demo, options)
    theirs = load_config(config_path(baseline.config(task, data, budget)), tmp_path, demo)
    apart = {'config_name'}
    if task == 'ins':  # how labels pass to regions, which none does here
        apart |= {'region_prior', 'label_maker', 'custom_hooks'}
    left = {key: value for key, value in ours.to_dict().items() if key not in apart}
    assert left == {key: value for key, value in theirs.to_dict().items() if key not in apart}


@pytest.mark.parametrize('path', METHODS_OF_FOLDER, ids=lambda path: path.stem)
def test_the_parts_of_a_method_are_used(path, tmp_path):
    config = load_config(path, tmp_path)
    used = ('model', 'train_dataloader', 'custom_hooks')
    for key in (name for name in config if name.startswith('method_') and config[name] is not None):
        without = load_config(path, tmp_path, options={key: None})
        assert any(config[part] != without[part] for part in used), f'{key} changes nothing that trains'


@pytest.mark.parametrize('path', SEGMENTATION, ids=lambda path: path.stem)
def test_every_config_of_points_shows_the_view_of_a_method(path, tmp_path):
    config = load_config(path, tmp_path, options={'method_view': {'type': 'MaskedView'}})
    assert 'MaskedView' in [step['type'] for step in config.train_dataloader.dataset.pipeline]
