"""Only what a user can mend becomes a ConfigError; faults of the program keep their traceback."""

import pytest
from mmengine.config import Config
from mmengine.registry import DefaultScope

from rm3d_plugin.datasets import FilesDataset
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.config_errors import config_errors
from rm3d_plugin.registry import DATASETS, DESCRIPTORS, MODELS, SCOPE
from rm3d_plugin.storage.files import content_key
from rm3d_plugin.structures import SceneError

CONFIG = Config({'config_name': 'mine'})


@pytest.fixture(autouse=True)
def _own_scope():
    with DefaultScope.overwrite_default_scope(SCOPE):
        yield


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: DESCRIPTORS.build({'type': 'Foo'}), 'mine: Foo is not in the rm3d_plugin::descriptor registry'),
        (lambda: DESCRIPTORS.build({'type': 'FPFH', 'radius': -1}), 'mine: FPFH: expected'),
        (lambda: DESCRIPTORS.build({'type': 'FPFH', 'foo': 1}), "mine: .*unexpected keyword argument 'foo'"),
        (lambda: DATASETS.build({'type': 'FilesDataset', 'data_root': 5}), r'mine: FilesDataset: a value of the wrong'),
        (
            lambda: MODELS.build({'type': 'SparseUNet', 'in_channels': 5, 'widths': [8.5, 16], 'voxel_size': 1}),
            'mine: .*got float',
        ),
        (lambda: DATASETS.build({'type': 'FilesDataset', 'data_root': '.', 'split': 'x'}), 'mine: split: expected one'),
    ],
)
def test_wrong_settings_are_told(build, message):
    with pytest.raises(ConfigError, match=message), config_errors(CONFIG):
        build()


def test_errors_for_users_pass():
    with pytest.raises(SceneError, match='torn'), config_errors(CONFIG):
        raise SceneError('torn')


def test_faults_of_the_program_stay_what_they_are(monkeypatch):
    with pytest.raises(TypeError), config_errors(CONFIG):
        content_key(object())
    monkeypatch.setattr(FilesDataset, 'find_scenes', lambda self: self.nothing)
    with pytest.raises(AttributeError), config_errors(CONFIG):
        len(DATASETS.build({'type': 'FilesDataset', 'data_root': '.'}))
