"""Names of classes are compared without letter case: two that differ in it only are one class."""

import json

import numpy as np
import pytest

from rm3d_plugin.annotation.click_log import ClickLog
from rm3d_plugin.class_names import check_class_names, class_index
from rm3d_plugin.datasets.files import FilesDataset, class_numbers
from rm3d_plugin.datasets.kitti import KittiDataset
from rm3d_plugin.datasets.named_boxes import NamedBoxes
from rm3d_plugin.datasets.other_classes import numbers_by_name
from rm3d_plugin.datasets.segmentation import numbers_of_things
from rm3d_plugin.engine.config import ConfigError, load_config
from rm3d_plugin.evaluation import KittiMetric
from rm3d_plugin.evaluation.point_fields import class_names
from rm3d_plugin.storage import ClickFileError, click_classes, read_clicks
from rm3d_plugin.storage.click_log_lines import read_click_log

TWICE = ['Car', 'tree', 'car']


def test_the_very_name_goes_first():
    assert class_index('car', ('Car', 'car')) == 1  # a list that nobody checked
    assert class_index('STRASSE', ('straße',)) == 0
    assert class_index('', ('a',)) is None


@pytest.mark.parametrize(
    'make',
    [
        lambda folder: check_class_names(TWICE, 'classes'),
        lambda folder: FilesDataset(folder, classes=TWICE),
        lambda folder: KittiDataset(folder, classes=TWICE),
        lambda folder: KittiMetric(classes=TWICE).class_names,
        lambda folder: class_names(TWICE, None, 'SemSegMetric'),
        lambda folder: load_config('rm3d_sem_files_streets_clicks', options={'class_names': TWICE}),
    ],
)
def test_two_spellings_of_a_class_are_refused(make, tmp_path):
    with pytest.raises((ValueError, ConfigError), match="'Car' and 'car' are one class"):
        make(tmp_path)


def test_labels_find_their_class():
    boxes = NamedBoxes(['CAR', 'bus', 'tree'], np.ones((3, 7))).of_classes(('Tree', 'Car'))
    assert boxes.labels.tolist() == [1, 0]
    assert numbers_by_name(('Floor', 'beam'), ('wall', 'floor')).tolist() == [1, -1]
    assert class_numbers({2: 'Ground', '5': 'TREE', 0: -1}, ('ground', 'tree')) == {2: 0, 5: 1, 0: -1}
    assert numbers_of_things(['Chair', 'SOFA'], ('sofa', 'wall', 'chair')) == (0, 2)


def test_clicks_find_their_class(tmp_path):
    path = tmp_path / 'clicks.csv'
    path.write_text('scene,index,class\na,0,Tree\na,1,tree\na,2,ROAD\n')
    assert click_classes(path) == ['ROAD', 'Tree']
    assert [click.semantic for click in read_clicks(path, ('road', 'tree'))] == [1, 1, 0]


def test_a_log_keeps_one_spelling(tmp_path):
    path = tmp_path / 'log.jsonl'
    log = ClickLog(path)
    assert (log.add_class('Car'), log.add_class('tree'), log.add_class('car', '#102030')) == (0, 1, 0)
    with pytest.raises(ClickFileError, match='a free name'):
        log.rename_class('tree', 'CAR')
    log.rename_class('Car', 'CAR')
    assert log.classes == ('CAR', 'tree') and log.colors == {'CAR': '#102030'}
    assert 'car' in path.read_text() and json.loads(path.read_text().splitlines()[-1]) == {'rename': 'Car', 'to': 'CAR'}
    again = read_click_log(path, ())
    assert again.classes == ('CAR', 'tree') and again.colors == {'CAR': '#102030'}
