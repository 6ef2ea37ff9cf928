import pytest
from mmengine.config import Config

from rm3d_plugin.engine.config import ConfigError, load_config, resolve, unknown_options

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
def leaf(tmp_path):
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


def test_unknown_options_lists_them():
    config = Config({'a': 1, 'b': {'c': 2}})
    assert unknown_options(config, {'a': 1, 'b.x': 1, 'c': 1, 'd.e': 1}) == ['c', 'd.e']


@pytest.mark.parametrize(
    ('value', 'names', 'message'),
    [
        ('${b}', {'a': 1}, r"config: '\$\{b\}' names no key of the config; top-level keys: \['a'\]"),
        ({'x': ['${a.c}']}, {'a': {'b': 1}}, r"config\.x\[0\]: '\$\{a\.c\}' names no key"),
        ('${a.b.c}', {'a': {'b': 1}}, 'names no key'),
        ('${a}', {'a': '${b}', 'b': '${a}'}, 'references go in a circle'),
        ('${a}', {'a': ['${a}']}, 'references go in a circle'),
        ('x ${a}', {'a': 'y ${a}'}, 'references go in a circle'),
    ],
)
def test_bad_references_are_named(value, names, message):
    with pytest.raises(ConfigError, match=message):
        resolve(value, names)


def test_a_reference_inside_text_is_written_out():
    assert resolve('${n} of ${m.k}', {'n': 3, 'm': {'k': 'ten'}}) == '3 of ten'
    assert resolve({'a': None, 'b': 2.5, 'c': '$x {y}'}, {}) == {'a': None, 'b': 2.5, 'c': '$x {y}'}


def test_what_cannot_be_read_is_refused(leaf, tmp_path):
    with pytest.raises(ConfigError, match=r'absent\.py: no such config; see configs/'):
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
        with pytest.raises(ConfigError, match=f'{key}: expected a whole number from 1, got {value!r}'):
            load_config(leaf, options={key: value})
