"""The loss of docs/parts.md, and the config that uses it, as a user would type them."""

import re
import sys

import pytest
from configs.leaves import ROOT
from mmengine.dataset import pseudo_collate
from mmengine.registry import DefaultScope
from models.segmentors.coloured_boxes import make_room

from rm3d_plugin.engine.config import load_config
from rm3d_plugin.registry import MODELS, SCOPE

TEXT = (ROOT / 'docs' / 'parts.md').read_text(encoding='utf-8')


def block(name: str) -> str:
    """The code that follows the comment with its file's name."""
    return re.search(rf'```python\n# {name}\n(.*?)```', TEXT, re.DOTALL)[1]


@pytest.fixture
def leaf(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / 'my_losses.py').write_text(block('my_losses.py'))
    path = tmp_path / 'my_config.py'
    path.write_text(block('my_config.py').replace("'./", f"'{ROOT}/configs/"))
    yield path
    sys.modules.pop('my_losses', None)
    MODELS.module_dict.pop('EntropyLoss', None)


def test_it_is_one_more_term_of_the_loss(leaf):
    config = load_config(leaf, options={'voxel_size': 0.1, 'widths': [8, 16], 'num_classes': 3, 'thing_classes': []})
    with DefaultScope.overwrite_default_scope(SCOPE):
        model = MODELS.build(config.model)
    assert list(model.losses) == ['WeakSupervision', 'ViewConsistency', 'EntropyLoss']
    data = model.data_preprocessor(pseudo_collate([make_room(0, view=True)]), True)
    losses = model(**data, mode='loss')
    assert list(losses) == ['loss_wsl', 'loss_aug', 'loss_entropy'] and model.losses['EntropyLoss'].weight == 0.1
    logits = model(**data).logits.detach().softmax(1)
    once = -(logits * logits.log()).sum(1).mean()
    assert 0.05 * once < losses['loss_entropy'] < 0.2 * once  # .1 of the mean over the scene and its view
