"""``rm3d draw_labels``: budget files, clicks that can be read back, and a page that needs no network."""

import re

import numpy as np
import pytest
from reference.toy_scenes import ToyRooms
from runs import tiny_runs

from rm3d_plugin.commands.main import run
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.label_budgets import load_box_budget, load_point_budget
from rm3d_plugin.labeling.point_source import PointBudgetSource
from rm3d_plugin.registry import DATASETS
from rm3d_plugin.reporting.draw_labels import draw_labels
from rm3d_plugin.storage import read_clicks
from rm3d_plugin.structures import Boxes3D, PointCloud
from rm3d_plugin.visualization.label_picture import draw_label_picture

PNG = b'\x89PNG'
DATASETS.register_module(module=ToyRooms, force=True)


def tool(*arguments):
    return run('draw_labels', [str(a) for a in arguments])


def toy(out, *more):
    return tool('--dataset', 'ToyRooms', '--out', out, *more)


def test_a_folder_gets_everything(tmp_path, capsys):
    assert toy(tmp_path / 'out', '--budget', 'onept_instance', '--seed', 3, '--dataset-options', 'count=2') == 0
    told = capsys.readouterr().out
    assert 'seed 3: 10 of' in told and 'box' in told
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == [
        'budget.json',
        'budget.npz',
        'clicks.csv',
        'labels.html',
    ]
    budget = load_point_budget(tmp_path / 'out' / 'budget.json')
    assert budget.seed == 3 and budget.annotated_count == 10
    page = (tmp_path / 'out' / 'labels.html').read_text()
    assert page.count('data:image/png;base64,') == 2 and budget.hash in page
    assert 'Scene room1: 5 labelled points of 2300 points' in page
    assert not re.search(r'(src|href)="http', page)


def test_drawn_clicks_are_a_budget(tmp_path):
    assert toy(tmp_path / 'clicks.csv', '--budget', '20pts', '--dataset-options', 'count=2') == 0
    assert [path.name for path in tmp_path.iterdir()] == ['clicks.csv']
    clicks = read_clicks(tmp_path / 'clicks.csv', ('floor', 'box', 'wall'))
    assert len(clicks) == 40 and any(click.instance >= 0 for click in clicks)
    options = ['--dataset-options', 'count=2', 'truth=False']
    assert toy(tmp_path / 'again', '--budget', f'clicks={tmp_path / "clicks.csv"}', *options) == 0
    drawn = PointBudgetSource(ToyRooms(2), '20pts').budget
    again = load_point_budget(tmp_path / 'again' / 'budget.json')
    for scene, points in drawn.annotated.items():
        for ours, theirs in zip(points, again.annotated[scene], strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert (tmp_path / 'again' / 'clicks.csv').read_bytes() == (tmp_path / 'clicks.csv').read_bytes()


def test_only_the_page(tmp_path):
    assert toy(tmp_path / 'page.html', '--scenes', 1, '--budget', 'scenes20pct') == 0
    assert [path.name for path in tmp_path.iterdir()] == ['page.html']
    assert (tmp_path / 'page.html').read_text().count('data:image/png') == 1


def test_boxes_of_a_config(tmp_path, world):
    options = ['--cfg-options', f'data_root={world}']
    config = tiny_runs.CONFIG
    assert tool(config, '--out', tmp_path / 'out', '--budget', 'full', *options) == 0
    assert load_box_budget(tmp_path / 'out' / 'budget.json').complete
    assert 'labelled points in' in (tmp_path / 'out' / 'labels.html').read_text()
    assert tool(config, '--out', tmp_path / 'clicks.csv', *options) == 2


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ([], 'give either a config or --dataset'),
        (['x.py', '--dataset', 'ToyRooms'], 'give either'),
        (['--dataset', 'Nothing'], 'Nothing is not in the'),
        (['--dataset', 'ToyRooms', '--dataset-options', 'cuont=2'], 'cuont'),
        (['--dataset', 'ToyRooms', '--budget', '20'], "expected one of onept, .* got '20'"),
        (['--dataset', 'ToyRooms', '--budget', 'percent=half'], "percent: expected a number in .* got 'half'"),
        (['--dataset', 'ToyRooms', '--budget', 'clicks=none.csv'], 'none.csv: no such file of clicks'),
        (['--dataset', 'ToyRooms', '--out', 'labels.txt'], 'expected a folder, or a file that ends with'),
        (['none.py'], 'none.py: no such config'),
    ],
)
def test_what_can_be_mended_is_told(tmp_path, capsys, arguments, words):
    given = [str(tmp_path / word) if word == 'labels.txt' else word for word in arguments]
    assert tool(*(given if '--out' in given else [*given, '--out', tmp_path / 'out'])) == 2
    assert re.search(words, capsys.readouterr().err)
    assert not (tmp_path / 'out').exists()


def test_help_names_the_budgets(capsys):
    with pytest.raises(SystemExit):
        tool('--help')
    text = capsys.readouterr().out
    assert all(word in text for word in ('onept', '0p2pct', 'scenes5pct', 'clicks=FILE', '--cfg-options', 'examples'))


def test_other_sources_have_no_clicks(tmp_path):
    class Nothing(PointBudgetSource.__mro__[2]):
        classes, scene_ids = ('a',), ('s',)
        load_cloud = annotated_labels = None

    with pytest.raises(ConfigError, match='Nothing shows no points'):
        draw_labels(Nothing(), tmp_path / 'c.csv', 'x')


def test_pictures():
    rng = np.random.default_rng(0)
    cloud = PointCloud(
        rng.uniform(size=(500, 3)).astype(np.float32), colors=rng.uniform(size=(500, 3)).astype(np.float32)
    )
    semantic = np.full(500, -1)
    empty = draw_label_picture(cloud, semantic, ('a',))
    semantic[[3, 8]] = 0
    labelled = draw_label_picture(cloud, semantic, ('a',))
    assert empty[:4] == labelled[:4] == PNG and empty != labelled
    assert labelled == draw_label_picture(cloud, semantic, ('a',))
    boxes = Boxes3D(np.array([[0.5, 0.5, 0.5, 0.2, 0.2, 0.2, 0.3]]), np.array([0]))
    assert draw_label_picture(cloud, semantic, ('a',), boxes) != labelled
    for points in (0, 1):
        few = PointCloud(np.zeros((points, 3), dtype=np.float32))
        assert draw_label_picture(few, np.zeros(points, dtype=np.int64), ('a',))[:4] == PNG


def test_other_clicks_are_not_replaced(tmp_path, capsys):
    mine = 'scene,index,class\nscene_0000,3,wall\n'
    (tmp_path / 'clicks.csv').write_text(mine)
    for out in (tmp_path, tmp_path / 'clicks.csv'):
        assert toy(out, '--budget', '20pts', '--dataset-options', 'count=2') == 2
        assert 'clicks.csv: holds other clicks, which are not replaced; name another place' in capsys.readouterr().err
        assert [path.name for path in tmp_path.iterdir()] == ['clicks.csv']
        assert (tmp_path / 'clicks.csv').read_text() == mine
