"""A checkpoint of a stranger builds our own parts and runs nothing else."""

import json
import pickle
import sys

import pytest
import torch
from runs.random_segmentor import make_checkpoint, make_scan

from rm3d_plugin.commands.main import run
from rm3d_plugin.engine.checkpoint import read_checkpoint
from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.hooks import SafeCheckpointHook
from rm3d_plugin.inference.trained import load_network


class Touch:
    """Pickled, it makes a file when it is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), 'w')


def changed(path, change):
    state = torch.load(path, weights_only=True)
    config = json.loads(state['meta']['config_json'])
    change(config)
    state['meta']['config_json'] = json.dumps(config)
    torch.save(state, path)
    return path


@pytest.mark.parametrize('kind', ['pathlib.Path.touch', 'os.system', 'builtins.exec', 'torch.load', 'mmengine.Linear'])
@pytest.mark.parametrize('place', ['model', 'backbone', 'pipeline', 'new', 'in a list'])
def test_dotted_types_are_refused_before_anything_is_built(tmp_path, kind, place, monkeypatch):
    bad = dict(type=kind, command='touch ran', f='ran')

    def change(config):
        model, dataset = config['model'], config['val_dataloader']['dataset']
        if place == 'model':
            config['model'] = bad
        elif place == 'pipeline':
            dataset['pipeline'].append(bad)
        else:
            model |= {'backbone': bad} if place == 'backbone' else {'losses': [[bad]] if place == 'in a list' else bad}

    path = changed(make_checkpoint(tmp_path / 'net.pth'), change)
    monkeypatch.setattr('rm3d_plugin.registry.PartRegistry.build', lambda *_: pytest.fail('something was built'))
    with pytest.raises(ConfigError, match=f"{kind}' is no part of rm3d_plugin"):
        load_network(path)


@pytest.mark.parametrize(
    ('part', 'message'),
    [
        (dict(_scope_='mmengine'), r"backbone\._scope_: expected rm3d_plugin, got 'mmengine'"),
        (dict(init_cfg=dict(type='Pretrained', checkpoint='evil.pth')), r"backbone\.init_cfg\.type: 'Pretrained'"),
        (dict(type=['os', 'system']), r"backbone\.type: \['os', 'system'\] is no part"),
    ],
)
def test_scopes_and_initialisers_are_refused(tmp_path, part, message):
    path = changed(make_checkpoint(tmp_path / 'net.pth'), lambda config: config['model']['backbone'].update(part))
    with pytest.raises(ConfigError, match=message):
        load_network(path)


def test_hooks_and_imports_of_a_checkpoint_are_not_looked_at(tmp_path):
    def change(config):
        config['custom_imports'] = dict(imports=['no_such_module'])
        config['custom_hooks'] = [dict(type='os.system', command='false')]

    assert load_network(changed(make_checkpoint(tmp_path / 'net.pth'), change)).classes


@pytest.mark.parametrize('number', [10**400, 10**9, -(10**9), float('inf')])
def test_sizes_beyond_the_weights_are_refused_before_room_is_made(tmp_path, number):
    def change(config):
        config['model']['backbone']['widths'][1] = number

    path = changed(make_checkpoint(tmp_path / 'net.pth'), change)
    with pytest.raises(ConfigError, match=r'net\.pth: model\.backbone\.widths\[1\]: .* is larger than the network'):
        load_network(path)


@pytest.fixture
def evil(tmp_path, monkeypatch):
    """A module that leaves a file when it is imported or called, and that file."""
    ran = tmp_path / 'ran'
    (tmp_path / 'evil.py').write_text(f'def touch(**_):\n    open({str(ran)!r}, "w")\n\n\ntouch()\n')
    monkeypatch.syspath_prepend(tmp_path)
    yield ran
    sys.modules.pop('evil', None)


EVIL = dict(type='evil.touch')


def everywhere(config):
    """All that training would build or import."""
    config['custom_imports'] = dict(imports=['evil'], allow_failed_imports=False)
    config |= {'custom_hooks': [EVIL], 'default_hooks': dict(logger=EVIL), 'env_cfg': EVIL, 'visualizer': EVIL}
    config |= {'_base_': ['evil.py'], 'default_scope': 'evil', 'train_cfg': EVIL, 'optim_wrapper': EVIL}
    config |= {'val_evaluator': EVIL, 'test_dataloader': EVIL, 'train_dataloader': dict(dataset=EVIL)}
    config['val_dataloader'] |= {'sampler': EVIL, 'collate_fn': EVIL}


def in_the_pipeline(config):
    config['val_dataloader']['dataset']['pipeline'].insert(0, EVIL)


def in_the_preprocessor(config):
    config['model']['data_preprocessor'] = EVIL


def in_a_scope(config):
    config['model'] |= {'type': 'touch', '_scope_': 'evil'}


@pytest.mark.parametrize(
    ('change', 'code'), [(everywhere, 0), (in_the_pipeline, 2), (in_the_preprocessor, 2), (in_a_scope, 2)]
)
def test_a_prediction_runs_nothing_of_a_stranger(tmp_path, evil, change, code, capsys):
    path, scan = changed(make_checkpoint(tmp_path / 'net.pth'), change), make_scan(tmp_path / 'scan.ply')
    assert run('predict', [str(path), str(scan), '--out', str(tmp_path / 'out')]) == code
    assert not evil.exists() and 'evil' not in sys.modules
    assert ('is no part of rm3d_plugin' in capsys.readouterr().err) == (code == 2)
    assert (tmp_path / 'out' / 'scan.ply').exists() == (code == 0)


def test_a_prediction_writes_into_no_folder_of_a_stranger(tmp_path):
    part = dict(descriptor=dict(type='AdaptedPFH', radius=2.0), oversegmenter=dict(type='RegionGrowing', max_edge=1.0))

    def change(config):
        pipeline = config['val_dataloader']['dataset']['pipeline']
        pipeline.insert(0, dict(type='RegionNumbers', cache=str(tmp_path / 'named'), **part))

    path, scan = changed(make_checkpoint(tmp_path / 'net.pth'), change), make_scan(tmp_path / 'scan.ply')
    assert run('predict', [str(path), str(scan), '--out', str(tmp_path / 'out')]) == 0
    assert not (tmp_path / 'named').exists() and (tmp_path / 'out' / 'scan.ply').exists()


def test_a_config_as_text_is_not_run_on_resuming(tmp_path):
    """mmengine runs ``meta.config`` of a checkpoint that it resumes."""
    ran = tmp_path / 'ran'
    path = make_checkpoint(tmp_path / 'net.pth')
    state = torch.load(path, weights_only=True)
    state['meta'] |= {'config': f'open({str(ran)!r}, "w")', 'epoch': 0, 'iter': 0}
    torch.save(state, path)
    with pytest.raises(ConfigError, match=r'net\.pth: meta\.config holds a config as Python text, which would run'):
        read_checkpoint(path)
    SafeCheckpointHook().after_load_checkpoint(None, state)
    assert 'config' not in state['meta'] and not ran.exists()


def test_pickled_code_is_not_run(tmp_path):
    torch.save({'state_dict': {}, 'meta': Touch(tmp_path / 'ran')}, tmp_path / 'net.pth')
    (tmp_path / 'plain.pth').write_bytes(pickle.dumps(Touch(tmp_path / 'ran')))
    for name in ('net.pth', 'plain.pth'):
        with pytest.raises(ConfigError, match=f'{name}: not a checkpoint that loads safely') as caught:
            load_network(tmp_path / name)
        assert 'weights_only' not in str(caught.value)
    assert not (tmp_path / 'ran').exists()


@pytest.mark.parametrize('text', ['{', '[]', '{}', '{"model": {}}', '{"model": 1, "val_dataloader": 2}'])
def test_a_damaged_config_is_told(tmp_path, text):
    torch.save({'state_dict': {}, 'meta': {'config_json': text}}, tmp_path / 'net.pth')
    with pytest.raises(ConfigError, match=r'net\.pth: its config'):
        load_network(tmp_path / 'net.pth')
