"""What is told of a page of settings before anything is built: slips, kinds of values, where paths start."""

import pytest

from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.engine.config_pages import pages

BASE = "_base_ = ['rm3d_plugin::rm3d_sem_files_streets_clicks.py']\nclass_names = ['ground', 'tree']\n"


@pytest.fixture
def page(tmp_path):
    def write(text, name='my_scan', folder=''):
        (tmp_path / folder).mkdir(exist_ok=True)
        path = tmp_path / folder / f'{name}.py'
        path.write_text(BASE + text)
        return path

    return write


def test_a_page_is_read_without_running_it(page):
    found = pages(page('helper = 3\nbatch_size = helper\nimport os\n'))
    assert found[0].assigned == {'_base_', 'class_names', 'helper', 'batch_size'} and 'helper' in found[0].read
    assert [each.path.stem for each in found[1:]] == ['rm3d_sem_files_streets_clicks', 'files', 'outdoor']
    assert [each.shipped for each in found] == [False, True, True, True]


@pytest.mark.parametrize(('slip', 'meant'), [('batch_sise', 'batch_size'), ('voxelsize', 'voxel_size')])
def test_a_slip_in_a_name_is_told_with_what_was_meant(slip, meant, page):
    with pytest.raises(ConfigError, match=rf'my_scan\.py: {slip}: nothing reads it; did you mean {meant}\?'):
        load_config(page(f'{slip} = 2'))


def test_names_of_ones_own_are_allowed_where_something_reads_them(page):
    config = load_config(page("helper = 3\nbatch_size = helper\nfar = 9.0\nmax_gap = '${far}'\n_hidden = 1\n"))
    assert (config.batch_size, config.max_gap) == (3, 9.0)
    with pytest.warns(UserWarning, match='unrelated: no config of RM3D has such a key'):
        load_config(page('unrelated = 5'))


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ("voxel_size = 'abc'", "voxel_size: expected a number, as 0.4 is, got 'abc'"),
        ("widths = 'abc'", 'widths: expected a list, as .* is, got'),
        ("propagate = 'maybe'", 'propagate: expected True or False, as True is'),
        ('data_root = 5', "data_root: expected text, as 'data/scans' is, got 5"),
        ("region_prior = dict(gamma='high')", "gamma: expected a number, as 0.75 is, got 'high'"),
        ('accumulate = 0', 'accumulate: expected a whole number from 1, got 0'),
        ('checkpoint_interval = 2.5', 'checkpoint_interval: expected a whole number from 1, got 2.5'),
        ('sigma = 5', r'periods=\[80, 160\], .*: expected .* rounds x sigma = 15 epochs|batch'),
        ('rounds = 5', r'periods=\[80, 160\], .*: expected .* rounds x sigma = 400 epochs'),
    ],
)
def test_values_of_another_kind_are_refused(text, message, page):
    if text == 'sigma = 5':  # longer periods than training are only cut off
        assert load_config(page(text)).epochs == 15
        return
    with pytest.raises(ConfigError, match=message):
        load_config(page(text))


def test_options_are_told_with_their_full_key(page):
    with pytest.raises(ConfigError, match=r'^--cfg-options region_prior\.gamma: expected a number, as 0.75 is'):
        load_config(page(''), options={'region_prior.gamma': 'high'})
    assert load_config(page(''), options={'learning_rate': '${height_scale}'}).learning_rate == 5.0


def test_paths_of_a_page_start_at_its_folder(page, tmp_path, monkeypatch):
    path = page("data_root = 'scans'\nbudget = dict(clicks='clicks.csv')\n", folder='mine')
    monkeypatch.chdir(tmp_path / 'mine')
    config = load_config('my_scan.py')
    assert (config.data_root, config.budget.clicks) == ('scans', 'clicks.csv'), 'as they are written'
    monkeypatch.chdir(tmp_path)
    config = load_config(path)
    assert (config.data_root, config.budget.clicks) == ('mine/scans', 'mine/clicks.csv')
    assert config.train_dataloader.dataset.data_root == 'mine/scans'
    (tmp_path / 'other').mkdir()
    monkeypatch.chdir(tmp_path / 'other')
    config = load_config(path)
    assert config.data_root == str(tmp_path / 'mine' / 'scans')
    assert load_config(path, options={'data_root': 'here'}).data_root == 'here', 'options start where they are typed'
    further = tmp_path / 'other' / 'further.py'
    further.write_text(f"_base_ = '{path}'\nbatch_size = 2\n")
    assert load_config(further).data_root == str(tmp_path / 'mine' / 'scans'), 'of the page that says it'
    assert load_config('rm3d_sem_files_streets_clicks').data_root == 'data/scans', 'ours start at the working directory'
