"""The wheel, installed elsewhere, needs no checkout: train a shipped config, predict a scan, read the report."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from runs.tiny_runs import ROOT

CONFIG = 'rm3d_plugin::rm3d_sem_scannet_0p2pct.py'
SMALL = [
    'demo_data.num_train=2',
    'demo_data.num_val=1',
    'rounds=2',
    'sigma=1',
    'widths=[8,16]',
    'voxel_size=0.2',
    'crop_points=4000',
    'threads=1',
    'descriptor.max_neighbors=16',
]


def shell(*words, cwd, **environment):
    """Run a command; what it wrote to stdout."""
    done = subprocess.run(
        [*map(str, words)], cwd=cwd, env=os.environ | environment, capture_output=True, text=True, timeout=1200
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def installed(tmp_path_factory) -> Path:
    """Folder that holds the package as the wheel has it."""
    source, folder = tmp_path_factory.mktemp('source'), tmp_path_factory.mktemp('installed')
    for name in ('setup.py', 'pyproject.toml', 'README.md', 'LICENSE'):
        shutil.copy(ROOT / name, source / name)
    for name in ('rm3d_plugin', 'configs'):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns('__pycache__'))
    pip = [sys.executable, '-m', 'pip', '--quiet', '--disable-pip-version-check']
    shell(*pip, 'wheel', '--no-deps', '--no-build-isolation', '--wheel-dir', source / 'dist', source, cwd=source)
    (wheel,) = (source / 'dist').glob('*.whl')
    shell(*pip, 'install', '--no-deps', '--target', folder, wheel, cwd=source)
    _bring_compiled(folder)
    return folder


def _bring_compiled(folder: Path) -> None:
    """Kernels that the checkout has compiled: they belong to sources of the same name, size and time."""
    for cached in (ROOT / 'rm3d_plugin').rglob('__pycache__'):
        here = folder / cached.relative_to(ROOT)
        here.mkdir(exist_ok=True)
        for file in cached.glob('*.nb?'):
            shutil.copy(file, here / file.name)
        for source in cached.parent.glob('*.py'):
            shutil.copystat(source, here.parent / source.name)


@pytest.mark.slow
def test_train_predict_and_report_without_a_checkout(installed, tmp_path):
    rm3d, only = installed / 'bin' / 'rm3d', {'PYTHONPATH': str(installed)}
    where = shell(sys.executable, '-c', 'import rm3d_plugin; print(rm3d_plugin.__file__)', cwd=tmp_path, **only)
    assert Path(where.strip()).parent == installed / 'rm3d_plugin'
    assert 'inspect_merges' in shell(rm3d, '--help', cwd=tmp_path, **only)
    told = shell(rm3d, 'train', CONFIG, '--demo', '--work-dir', 'run', '--cfg-options', *SMALL, cwd=tmp_path, **only)
    assert 'mIoU' in told and told.splitlines()[-1] == 'report: run/report.html'
    assert (tmp_path / 'run' / 'report.html').stat().st_size > 10000
    scan = next((tmp_path / 'data' / 'scannet_rooms').rglob('*_vh_clean_2.ply'))
    shell(rm3d, 'predict', 'run/epoch_2.pth', scan, '--out', 'classes', cwd=tmp_path, **only)
    assert [path.name for path in (tmp_path / 'classes').iterdir()] == [f'{scan.stem}.ply']


@pytest.mark.slow
def test_the_wheel_holds_every_config(installed):
    shipped = installed / 'rm3d_plugin' / 'configs'
    files = {path.relative_to(ROOT / 'configs') for path in (ROOT / 'configs').rglob('*.py')}
    assert {path.relative_to(shipped) for path in shipped.rglob('*.py')} == files
