"""Every row of docs/ablations.md is a config that builds, and another one than its base."""

import argparse
import re
from pathlib import Path

import pytest
from configs.leaves import ROOT
from configs.test_segmentation_configs import build_label_maker, model_of
from mmengine.config import DictAction
from mmengine.registry import DefaultScope

from rm3d_plugin.engine.config import load_config
from rm3d_plugin.models.losses import MSEAugLoss
from rm3d_plugin.registry import SCOPE

RULES = ('merge', 'propagation', 'region_prior', 'ground', 'self_training')
TEXT = (ROOT / 'docs' / 'ablations.md').read_text(encoding='utf-8')


def rows() -> list[tuple[str, str]]:
    """Base config and options of each row of the tables."""
    base, added, found = '', '', []
    for line in TEXT.splitlines():
        if named := re.fullmatch(r'Base: `([^`]+)`(?: with `(.+)`)?', line):
            base, added = named[1], named[2] or ''
        elif line.startswith('|') and (options := re.search(r'`([^`]+=[^`]*)` \|$', line)):
            own = '' if 'strategy=' in options[1] else added
            found.append((base, f'{own} {options[1]}'.strip()))
    return found


def options_of(text: str) -> dict:
    """As the command line reads them."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--cfg-options', nargs='+', action=DictAction)
    return parser.parse_args(['--cfg-options', *text.split()]).cfg_options


def loaded(base: str, text: str, folder: Path):
    own = {'data_root': str(folder / 'data'), 'cache_dir': str(folder / 'cache')}
    return load_config(ROOT / base, folder / 'run', options=own | options_of(text))


def shown(config, hook):
    """All that a row may change."""
    return config.model, hook, config.epochs, config.train_pipeline, config.param_scheduler


@pytest.mark.parametrize(('base', 'text'), rows(), ids=lambda value: value.rpartition('/')[2])
def test_a_row_builds_and_differs_from_its_base(base, text, tmp_path):
    config = loaded(base, text, tmp_path)
    with DefaultScope.overwrite_default_scope(SCOPE):
        model, made = model_of(config), build_label_maker(config)
    plain = loaded(base, 'strategy=regions', tmp_path)
    hook, before = config.custom_hooks[1], plain.custom_hooks[1]
    assert shown(config, hook) != shown(plain, before)
    for key, value in options_of(text).items():
        group, _, name = key.partition('.')
        if group in RULES and name:
            found = getattr(getattr(made.rules, group), name)
            assert (list(found) if isinstance(found, tuple) else found) == value
    if 'MSE' in text:
        assert type(model.losses['ViewConsistency'].loss) is MSEAugLoss
    if 'aug_loss=None' in text:
        assert list(model.losses) == ['WeakSupervision', 'InstanceOffsets', 'InstanceDice']


def test_the_page_has_all_rows_of_the_papers_tables():
    assert len(rows()) > 40
    found = ' '.join(text for _, text in rows())
    for term in ('color', 'scale', 'descriptor', 'semantics'):
        assert f'merge.without=[{term}]' in found
    assert 'merge.lambda_normal=0' in found and 'merge.lambda_descriptor=0' in found
