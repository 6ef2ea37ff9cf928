"""What ``rm3d info`` tells."""

import re
from pathlib import Path

import torch

from rm3d_plugin import __version__
from rm3d_plugin.commands.info import data_sets, known_data, main
from rm3d_plugin.engine.config import load_config

ROOT = Path(__file__).resolve().parents[2]


def test_versions_devices_and_data(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('RM3D_REAL_DATA', raising=False)
    (tmp_path / 'data' / 'scannet').mkdir(parents=True)
    main([])
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line}
    assert __version__ in lines['rm3d_plugin'] and torch.__version__.split('+')[0] in lines['torch']
    assert 'cores' in lines['processor'] and 'torch' in lines['threads']
    assert lines['scannet'].endswith('data/scannet: there')
    assert 'data/kitti: not there; data_root=FOLDER, or --demo' in lines['kitti']
    assert lines['RM3D_REAL_DATA'].endswith('not set')


def test_real_data_are_named(monkeypatch, tmp_path):
    monkeypatch.setenv('RM3D_REAL_DATA', str(tmp_path))
    assert data_sets(tmp_path)[-1].endswith(f'{tmp_path}: there')


def test_places_are_those_of_the_configs(tmp_path):
    assert known_data()['scannet'] == load_config('rm3d_sem_scannet_0p2pct', tmp_path).data_root


def test_one_version_everywhere():
    setup, citation = (ROOT / 'setup.py').read_text(), (ROOT / 'CITATION.cff').read_text()
    changes = re.findall(r'^## \[([\d.]+)\]', (ROOT / 'CHANGELOG.md').read_text(), re.MULTILINE)
    assert re.search(r"version='([\d.]+)'", setup)[1] == __version__ == changes[0]
    assert re.search(r'^version: (.+)$', citation, re.MULTILINE)[1] == __version__
