import sys

import pytest
from mmengine.config import Config
from mmengine.runner import Runner

import rm3d_plugin
from rm3d_plugin.engine.config import ConfigError, load_config, resolve, unknown_options
from rm3d_plugin.engine.config_files import find_config, shipped_configs, shipped_leaves
from rm3d_plugin.engine.renamed_options import RENAMED
from rm3d_plugin.engine.run import check_data, check_optimizer

LEAF = """
_base_ = ['./base.py']
data_root = 'data/kitti'
rounds = 2
sigma = 3
label_refreshes = '${rounds}'
loader = dict(batch_size='${size.batch}', dataset=dict(root='${data_root}', file='${data_root}/${name}.txt'))
twin = '${loader}'
steps = ['${sigma}', ('${rounds}', 'at ${work_dir}')]
size = dict(batch=16)
name = 'train'
demo = dict(data_root='data/demo', sigma=1, size=dict(batch=4))
"""


@pytest.fixture
def leaf(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where relative paths of the page start
    (tmp_path / 'base.py').write_text('seed = 7\nseed_again = "${seed}"\n')
    path = tmp_path / 'leaf.py'
    path.write_text(LEAF)
    return path


def test_references_become_values_of_their_type(leaf):
    config = load_config(leaf, work_dir='out')
    assert config.label_refreshes == 2 and config.seed_again == 7
    assert config.loader == {'batch_size': 16, 'dataset': {'root': 'data/kitti', 'file': 'data/kitti/train.txt'}}
    assert config.twin == config.loader
    assert config.steps == [3, (2, 'at out')]
    assert (config.epochs, config.is_demo, config.config_name, config.work_dir) == (6, False, 'leaf', 'out')
    assert 'demo' not in config


def test_demo_wins_over_the_config_and_options_over_both(leaf):
    demo = load_config(leaf, demo=True)
    assert (demo.data_root, demo.sigma, demo.rounds, demo.epochs, demo.size.batch) == ('data/demo', 1, 2, 2, 4)
    assert demo.loader.dataset.file == 'data/demo/train.txt' and demo.is_demo
    assert demo.work_dir == 'work_dirs/leaf_demo' and load_config(leaf).work_dir == 'work_dirs/leaf'
    both = load_config(leaf, demo=True, options={'sigma': 5, 'size.batch': 1, 'name': 'val'})
    assert (both.sigma, both.epochs, both.loader.batch_size) == (5, 10, 1)
    assert both.twin.dataset.file == 'data/demo/val.txt'


def test_options_reach_below_a_reference_only_at_its_source(leaf):
    assert load_config(leaf, options={'loader.batch_size': 2}).twin.batch_size == 2
    with pytest.raises(ConfigError, match=r'twin\.batch_size: twin holds no keys of its own.*what it refers to'):
        load_config(leaf, options={'twin.batch_size': 2})


@pytest.mark.parametrize('key', ['nonsense', 'nonsense.deep', 'data_roto'])
def test_options_that_name_no_key_are_refused(leaf, key):
    with pytest.raises(ConfigError, match=rf'--cfg-options {key}: no such key.*data_root'):
        load_config(leaf, options={key: 1, 'seed': 2})


@pytest.mark.parametrize(
    ('option', 'said'),
    [
        ({'log_level': 'foo'}, "log_level: expected DEBUG or INFO or WARNING or ERROR or CRITICAL, got 'foo'"),
        ({'default_scope': 'foo'}, "default_scope: expected rm3d_plugin, got 'foo'"),
        ({'batch_sise': 4}, r'--cfg-options batch_sise: no such key in the config; did you mean batch_size\?'),
    ],
)
def test_words_that_are_none_are_told(option, said):
    with pytest.raises(ConfigError, match=said):
        load_config('rm3d_sem_files_streets_clicks', options=option)


def test_an_unknown_optimizer_is_told():
    config = Config({'optim_wrapper': {'optimizer': {'type': 'SGDD'}}})
    with pytest.raises(ConfigError, match=r"optim_wrapper\.optimizer\.type: expected one of .*SGD, .*; got 'SGDD'"):
        check_optimizer(config)
    config.optim_wrapper.optimizer.type = 'SGD'
    check_optimizer(config)


def test_a_cache_that_is_a_file_is_told_before_scenes_are_prepared(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(
        ConfigError, match=f'cache_dir {tmp_path}/file/geometry: {tmp_path}/file is a file; name a folder'
    ):
        check_data(Config({'cache_dir': str(tmp_path / 'file' / 'geometry')}))


def test_unknown_options_lists_them():
    config = Config({'a': 1, 'b': {'c': 2}})
    assert unknown_options(config, {'a': 1, 'b.x': 1, 'c': 1, 'd.e': 1}) == ['c', 'd.e']


@pytest.mark.parametrize(
    ('config', 'message'),
    [
        ({'x': '${b}', 'a': 1}, r"config: x: Interpolation key 'b' not found; top-level keys: \['a', 'x'\]"),
        ({'x': {'y': ['${a.c}']}, 'a': {'b': 1}}, r"config: x\.y\[0\]: Interpolation key 'a\.c' not found"),
        ({'x': '${a.b.c}', 'a': {'b': 1}}, r'x: .*a\.b'),
        ({'a': '${b}', 'b': '${a}'}, 'a: Recursive interpolation'),
        ({'a': ['${a}']}, r'a\[0\]: Interpolation to parent node'),
        ({'a': 'y ${a}'}, 'a: Recursive interpolation'),
        ({'b': {'a': '${'}}, r"b\.a: .*'\$\{'"),
    ],
)
def test_bad_references_are_named(config, message):
    with pytest.raises(ConfigError, match=message):
        resolve(config)


def test_a_reference_becomes_any_value_or_is_written_out():
    values = {'n': 3, 'm': {'k': 'ten', 'none': None, 'list': [1, (2, 'x')]}, 0: {1: 2.5}, 'plain': '$x {y}'}
    asked = {'text': '${n} of ${m.k}', 'none': '${m.none}', 'list': '${m.list}', 'second': '${m.list.1}', 'all': '${m}'}
    found = resolve(values | asked)
    assert found['text'] == '3 of ten' and found['none'] is None and found['second'] == (2, 'x')
    assert found['list'] == [1, (2, 'x')] and found['all'] == values['m']
    assert {key: found[key] for key in values} == values
    assert resolve({'task': 'b', 'tasks': {'a': 1, 'b': [2]}, 'x': '${tasks.${task}}'})['x'] == [2]


def test_what_cannot_be_read_is_refused(leaf, tmp_path):
    with pytest.raises(ConfigError, match=r'absent\.py: no such config; those of RM3D are in .*configs'):
        load_config(tmp_path / 'absent.py')
    with pytest.raises(ConfigError, match='no such config'):
        load_config(tmp_path)
    (tmp_path / 'notes.txt').write_text('rounds = 2')
    with pytest.raises(ConfigError, match=r'notes\.txt: expected a \.py config, got \.txt'):
        load_config(tmp_path / 'notes.txt')
    for number, text in enumerate(('rounds = = 2', "_base_ = ['./absent.py']", 'rounds = missing')):
        (tmp_path / f'bad{number}.py').write_text(text)
        with pytest.raises(ConfigError, match=rf'bad{number}\.py: cannot be read as a config'):
            load_config(tmp_path / f'bad{number}.py')
    leaf.write_text(LEAF.replace('demo =', 'other ='))
    with pytest.raises(ConfigError, match='no `demo` settings'):
        load_config(leaf, demo=True)


@pytest.mark.parametrize('value', [0, -1, 2.5, 'many', None])
def test_rounds_and_sigma_are_whole_numbers_from_one(leaf, value):
    for key in ('rounds', 'sigma'):
        with pytest.raises(ConfigError, match=f'{key}: expected a (whole )?number.*, got {value!r}'):
            load_config(leaf, options={key: value})


def test_what_is_off_is_switched_on_with_its_fields(leaf):
    leaf.write_text(LEAF + "ground = None\nbudget = '1pct'\n")
    for key, value in (('ground.reach', 3), ('ground', {'reach': 3})):
        assert load_config(leaf, options={key: value}).ground == {'reach': 3}
    assert load_config(leaf, options={'ground._delete_': True, 'ground.reach': 3}).ground == {'reach': 3}
    assert load_config(leaf, options={'budget.clicks': 'a.csv'}).budget == {'clicks': 'a.csv'}
    page = leaf.with_name('page.py')
    page.write_text(f"_base_ = '{leaf}'\nground = dict(reach=2)\nbudget = dict(clicks='b.csv')\nsize = dict(more=1)\n")
    config = load_config(page)
    assert (config.ground, config.budget) == ({'reach': 2}, {'clicks': 'b.csv'})
    assert config.size == {'batch': 16, 'more': 1}, 'a dict over a dict goes on from it'


@pytest.mark.parametrize('kind', ['streets', 'rooms', 'airborne'])
def test_documented_settings_of_own_scans_need_no_delete(kind, tmp_path):
    page = tmp_path / 'my_scan.py'
    page.write_text(
        f"""_base_ = ['rm3d_plugin::rm3d_sem_files_{kind}_clicks.py']
class_names = ['ground', 'tree']
columns = dict(label='classification')
label_map = {{2: 'ground', 5: 'tree', 0: -1}}
visualizer = dict(type='Visualizer', vis_backends=[dict(type='LocalVisBackend')])
ground = dict(min_upright=0.9)
"""
    )
    config = load_config(page)
    assert config.num_classes == config.model.num_classes == 2
    for name in ('train_dataloader', 'label_dataloader', 'val_dataloader'):
        dataset = config[name].dataset
        assert dataset.columns == {'label': 'classification'} and dataset.label_map == {2: 'ground', 5: 'tree', 0: -1}
    assert config.visualizer.type == 'Visualizer' and config.ground == {'min_upright': 0.9}


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('num_classes = 3', 'num_classes=3: class_names has 2: ground, tree; leave num_classes out'),
        ("class_names = ['a', 'a']", "class_names: 'a' and 'a' are one class"),
        ("class_names = 'tree'", "class_names: expected a list of names, each once, got 'tree'"),
    ],
)
def test_as_many_classes_as_names(text, message, tmp_path):
    page = tmp_path / 'my_scan.py'
    base = "_base_ = ['rm3d_plugin::rm3d_sem_files_streets_clicks.py']\nclass_names = ['ground', 'tree']\n"
    page.write_text(base + text)
    with pytest.raises(ConfigError, match=message):
        load_config(page)


def test_label_refreshes_are_those_that_happen(leaf):
    leaf.write_text(LEAF.replace("label_refreshes = '${rounds}'", 'label_refreshes = None\nwarm_up_rounds = 3'))
    assert load_config(leaf, options={'rounds': 7}).label_refreshes == 5
    assert load_config(leaf).label_refreshes == 1, 'two rounds end before the first labels do'
    assert load_config(leaf, options={'rounds': 7, 'label_refreshes': 1}).label_refreshes == 1
    both = 'label_refreshes = None\nwarm_up_rounds = 3\nfinal_rounds = 2'
    leaf.write_text(LEAF.replace("label_refreshes = '${rounds}'", both))
    assert load_config(leaf, options={'rounds': 7}).label_refreshes == 4, 'rounds 0 to 2, 3, 4, and 5 to 6'


def test_old_names_are_told_with_the_new_ones(leaf):
    for option, message in (
        ({'strategy.hold_in': 0.1}, '--cfg-options strategy.hold_in is now self_training.holdout$'),
        ({'rules.class_gamma': 1}, '--cfg-options rules is now objects'),
        ({'strategy.near_place': 1}, 'strategy.near_place is gone'),
        ({'votes': 4, 'seed': 1}, '--cfg-options votes is now tta_rotations$'),
    ):
        with pytest.raises(ConfigError, match=message):
            load_config(leaf, options=option)
    leaf.write_text(LEAF + 'strategy = dict(hold_in=0.1, quota=0.2)\n')
    with pytest.raises(
        ConfigError, match=r'leaf\.py: strategy.hold_in is now self_training.holdout; strategy.quota is'
    ):
        load_config(leaf)
    leaf.write_text(LEAF.replace('demo = dict(', 'demo = dict(spread=False, '))
    with pytest.raises(ConfigError, match=r'leaf\.py: spread is now propagate'):
        load_config(leaf)


def test_no_config_uses_an_old_name():
    for path in shipped_leaves().values():
        assert not set(RENAMED) & set(load_config(path, 'run'))


@pytest.mark.parametrize(
    'name',
    [
        'rm3d_votenet_kitti_1pct',
        'rm3d_votenet_kitti_1pct.py',
        'rm3d_plugin::rm3d_votenet_kitti_1pct.py',
        'rm3d_plugin::rm3d_votenet_kitti_1pct',
        'sup_sem_scannet_full',
        'rm3d_plugin::sup_sem_scannet_full.py',
        'rm3d_plugin::baselines/sup_sem_scannet_full.py',
    ],
)
def test_what_comes_with_rm3d_is_found_by_name(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = rm3d_plugin.load_config(name)
    assert config.config_name == name.rpartition(':')[2].rpartition('/')[2].removesuffix('.py')


def test_a_file_of_ones_own_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_config('rm3d_votenet_kitti_1pct.py').parent == shipped_configs()
    (tmp_path / 'rm3d_votenet_kitti_1pct.py').write_text('rounds = sigma = 1\n')
    assert load_config('rm3d_votenet_kitti_1pct.py').epochs == 1


@pytest.mark.parametrize('name', ['rm3d_plugin::rm3d_sem_scanet_0p2pct.py', 'rm3d_sem_scanet_0p2pct'])
def test_a_misspelt_name_is_told_with_those_that_are_near(name):
    with pytest.raises(ConfigError, match='no such config; did you mean rm3d_sem_scannet_0p2pct or'):
        load_config(name)


def test_another_project_goes_on_from_a_shipped_config(tmp_path):
    own = tmp_path / 'mine.py'
    own.write_text("_base_ = 'rm3d_plugin::rm3d_votenet_kitti_1pct.py'\nsigma = 3\nobjects = dict(gamma=0.5)\n")
    config, plain = load_config(own), load_config('rm3d_votenet_kitti_1pct')
    assert (config.epochs, config.objects.gamma, config.config_name) == (24, 0.5, 'mine')
    assert config.model == plain.model and config.objects.class_gamma == plain.objects.class_gamma
    (tmp_path / 'again.py').write_text("_base_ = ['./mine.py']\nrounds = 2\n")
    assert load_config(tmp_path / 'again.py').epochs == 6
    own.write_text("_base_ = 'rm3d_plugin::absent.py'")
    with pytest.raises(ConfigError, match=r'rm3d_plugin::absent\.py: no such config'):
        load_config(own)


def test_reading_leaves_mmengine_as_it_was(leaf):
    before = Config._get_cfg_path, Config._merge_a_into_b
    load_config(leaf)
    with pytest.raises(ConfigError):
        load_config('rm3d_plugin::absent')
    assert (Config._get_cfg_path, Config._merge_a_into_b) == before


@pytest.mark.parametrize(('options', 'said'), [
    ({'merge.without': ['color']}, 'not read with strategy=default; add strategy=regions or strategy=paper'),
    ({'strategy': 'regions', 'walker.accept': 0.7}, 'not read with strategy=regions; add strategy=default'),
    ({'strategy': 'paper', 'ground.min_upright': 1}, 'not read with strategy=paper; add strategy=regions, or leave'),
])  # fmt: skip
def test_options_that_the_strategy_does_not_read_are_refused(options, said):
    with pytest.raises(ConfigError, match=said):
        load_config('rm3d_plugin::rm3d_sem_semantickitti_0p2pct.py', demo=True, options=options)
    read = {'merge.rounds': 3, 'walker.accept': 0.7, 'descriptor.type': 'FPFH'}
    assert load_config('rm3d_plugin::rm3d_sem_scannet_0p2pct.py', options=read).label_maker.walker.accept == 0.7
    load_config('rm3d_plugin::rm3d_votenet_kitti_1pct.py', options={'merge.without': ['color']})  # boxes: always read
    load_config('rm3d_plugin::sup_sem_scannet_0p2pct.py', options={'merge.without': ['color']})  # no labels are made


def test_custom_imports_of_the_command_line_are_imported(tmp_path, monkeypatch):
    (tmp_path / 'my_package_of_parts.py').write_text('')
    monkeypatch.syspath_prepend(tmp_path)
    for names in (['my_package_of_parts'], ['rm3d_plugin', 'my_package_of_parts'], 'my_package_of_parts'):
        load_config('rm3d_votenet_kitti_1pct', options={'custom_imports.imports': names})
        assert sys.modules.pop('my_package_of_parts')
    with pytest.raises(ConfigError, match='custom_imports: .*absent_package.*PYTHONPATH'):
        load_config('rm3d_votenet_kitti_1pct', options={'custom_imports.imports': ['absent_package']})


def test_mmengines_runner_takes_what_comes_back(world, tmp_path):
    sizes = {'widths': [8, 16], 'hidden': 16, 'voxel_size': 0.3, 'batch_size': 1, 'cache_dir': str(tmp_path / 'cache')}
    options = {'data_root': str(world), **sizes}
    config = rm3d_plugin.load_config('rm3d_plugin::rm3d_votenet_kitti_1pct.py', tmp_path / 'run', options=options)
    runner = Runner.from_cfg(config)
    assert runner.model.num_classes == 3 and len(runner.build_dataloader(config.val_dataloader)) == 1
    assert runner.experiment_name


def test_the_package_names_what_is_public():
    assert rm3d_plugin.load_config is load_config and rm3d_plugin.ConfigError is ConfigError
    assert set(rm3d_plugin.__all__) >= {'load_config', 'registry', '__version__'}
    with pytest.raises(AttributeError, match="module 'rm3d_plugin' has no attribute 'nothing'"):
        _ = rm3d_plugin.nothing
