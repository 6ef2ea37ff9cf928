"""A leaf is one page that reads two further files at most."""

import ast

import pytest
from configs.leaves import CONFIGS, DESCRIPTORS, LEAVES

from rm3d_plugin.baselines import BASELINES, COMBINATIONS
from rm3d_plugin.engine.config import load_config

BASES = sorted((CONFIGS / '_base_').glob('*.py'))
TOP_LEVEL = ('data_root', 'descriptor', 'oversegmenter', 'strategy', 'budget', 'rounds', 'sigma')
# What every run shares stands on each of these pages, so that a leaf reads no more files; it is the same on all.
PREFIXES = {each.leaf.partition('{')[0] for each in (*BASELINES.values(), *COMBINATIONS)}  # 'sup_', 'rm3d_csc_', ...
COMPLETE = ('indoor', 'outdoor', 'detection')
SHARED = (
    'custom_imports default_scope seed threads num_workers accumulate cache_dir checkpoint_interval randomness env_cfg '
    'default_hooks log_level visualizer custom_hooks train_cfg val_cfg test_cfg optim_wrapper restart_schedule '
    'warm_up_rounds final_rounds label_refreshes test_dataloader test_evaluator graph_neighbors budget_seed'
).split()


def values_of(path):
    """The assignments of a file."""
    scope = {}
    exec(compile(path.read_text(), str(path), 'exec'), scope)
    return {key: value for key, value in scope.items() if not key.startswith('__')}


def files_of(path):
    """A file and all that it reads through ``_base_``."""
    bases = values_of(path).get('_base_', [])
    bases = [bases] if isinstance(bases, str) else bases
    return [path, *(file for base in bases for file in files_of((path.parent / base).resolve()))]


@pytest.mark.parametrize('path', [*LEAVES, *DESCRIPTORS], ids=lambda path: path.stem)
def test_a_leaf_reads_two_further_files_at_most_and_is_short(path):
    files = files_of(path)
    assert len(files) <= 3 and files[1].parent == CONFIGS / '_base_'
    if not path.stem.startswith('check_'):
        most = 20 if path.parent.name == 'baselines' else 14  # the parts of a method stand on its leaf
        assert len(path.read_text().splitlines()) <= most


def test_every_base_is_read_by_a_leaf():
    assert {file for leaf in (*LEAVES, *DESCRIPTORS) for file in files_of(leaf)} == {*LEAVES, *DESCRIPTORS, *BASES}


@pytest.mark.parametrize('path', [*LEAVES, *DESCRIPTORS], ids=lambda path: path.stem)
def test_a_leaf_tells_what_it_is_its_command_time_and_score(path):
    what, command, time, score = path.read_text().splitlines()[:4]
    assert what.startswith('# ') and what.endswith('.')
    assert command.startswith(f'# Run: rm3d train {path.stem}')
    assert time.startswith('# Time') and score.startswith('# Score on ') and score.endswith('.')


def test_names_lead_to_the_method_or_to_what_it_is_compared_with():
    for path in LEAVES:
        assert path.stem.startswith(tuple(PREFIXES)) == (path.parent.name == 'baselines')
    assert len({path.stem for path in (*LEAVES, *DESCRIPTORS)}) == len(LEAVES) + len(DESCRIPTORS)


@pytest.mark.parametrize('path', LEAVES, ids=lambda path: path.stem)
def test_what_a_user_changes_is_a_key_of_its_own(path, tmp_path):
    config = load_config(path, tmp_path)
    assert all(key in config for key in TOP_LEVEL)
    moved = load_config(path, tmp_path, options={'data_root': '/my/data', 'strategy': 'paper'})
    for loader in ('train_dataloader', 'label_dataloader', 'val_dataloader', 'test_dataloader'):
        assert moved[loader].dataset.data_root == '/my/data'
    (hook,) = [hook for hook in moved.custom_hooks if hook.type == 'RegionMergeHook']
    assert hook.label_maker.strategy == 'paper' and hook.label_maker.source.dataset.data_root == '/my/data'


def test_what_every_run_shares_is_the_same_on_each_page():
    pages = [values_of(CONFIGS / '_base_' / f'{name}.py') for name in COMPLETE]
    for key in SHARED:
        assert all(page[key] == pages[0][key] for page in pages), key


@pytest.mark.parametrize('path', [*LEAVES, *DESCRIPTORS, *BASES], ids=lambda path: path.stem)
def test_no_arithmetic(path):
    assert not [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.BinOp)]
