"""Frames that cannot be used: named and refused, or with bad_scenes=skip left out, counted, and trained without."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from runs import tiny_runs


def cut_scan(base: Path, name: str) -> str:
    path = base / 'velodyne' / f'{name}.bin'
    path.write_bytes(path.read_bytes()[:-7])
    return f'{path}: '


def empty_scan(base: Path, name: str) -> str:
    path = base / 'velodyne' / f'{name}.bin'
    path.write_bytes(b'')
    return f'{path}: holds no points'


def nan_scan(base: Path, name: str) -> str:
    path = base / 'velodyne' / f'{name}.bin'
    points = np.fromfile(path, dtype='<f4').reshape(-1, 4)
    points[5, 1] = np.nan
    points.tofile(path)
    return f'{path}: 1 of {len(points)} points hold NaN'


def no_calib(base: Path, name: str) -> str:
    path = base / 'calib' / f'{name}.txt'
    path.unlink()
    return f'{path}: no such file'


def short_label(base: Path, name: str) -> str:
    path = base / 'label_2' / f'{name}.txt'
    path.write_text('Car 0 0 0 1 2 3 4 1.5 1.6 3.9 1 2 20\n')
    return f'{path}, line 1: expected 15 fields (16 with a score), got 14'


def no_label(base: Path, name: str) -> str:
    path = base / 'label_2' / f'{name}.txt'
    path.unlink()
    return f'{path}: no such file'


DAMAGES = (cut_scan, empty_scan, nan_scan, no_calib, short_label, no_label)


@pytest.mark.parametrize('damage', DAMAGES, ids=lambda damage: damage.__name__)
def test_a_bad_training_frame_is_named(damage, world, call, tmp_path):
    bad = shutil.copytree(world, tmp_path / 'bad' / 'kitti')
    message = damage(bad / 'training', '000001')
    code, output = call('train', *tiny_runs.arguments_of(tiny_runs.options(bad), tmp_path / 'run'))
    assert code == 2 and 'Traceback' not in output, output
    assert message in output.splitlines()[-1] and output.splitlines()[-1].startswith('error: ')


def test_a_bad_frame_that_a_worker_process_meets_is_named_as_briefly(world, call, tmp_path):
    bad = shutil.copytree(world, tmp_path / 'bad' / 'kitti')
    message = nan_scan(bad / 'training', '000003')  # of validation
    settings = tiny_runs.options(bad, num_workers=1, rounds=1)
    code, output = call('train', *tiny_runs.arguments_of(settings, tmp_path / 'run'))
    assert code == 2 and 'Traceback' not in output, output
    assert output.splitlines()[-1].startswith(f'error: scene 000003: {message}')


def test_bad_frames_are_left_out_with_a_count_and_training_goes_on(world, call, tmp_path):
    bad = shutil.copytree(world, tmp_path / 'bad' / 'kitti')
    frames = (bad / 'ImageSets' / 'train.txt').read_text().split()
    for number, damage in enumerate(DAMAGES):
        name = f'9000{number:02d}'
        for folder, suffix in (('velodyne', 'bin'), ('calib', 'txt'), ('label_2', 'txt')):
            base = bad / 'training' / folder
            shutil.copy(base / f'000000.{suffix}', base / f'{name}.{suffix}')
        damage(bad / 'training', name)
        frames.insert(number, name)
    (bad / 'ImageSets' / 'train.txt').write_text('\n'.join(frames) + '\n')
    short_label(bad / 'training', '000003')
    (bad / 'ImageSets' / 'val.txt').write_text('000000\n000003\n')
    settings = tiny_runs.options(bad, bad_scenes='skip', cache_dir=str(world.parent / 'geometry'))
    code, output = call('train', *tiny_runs.arguments_of(settings, tmp_path / 'run'))
    assert code == 0, output
    assert f'{len(DAMAGES)} of 9 scenes cannot be used and are left out: 900000: ' in output
    assert '1 of 2 scenes cannot be used and are left out: 000003: ' in output
    assert {scene for _, scene, _ in _labelled(tmp_path / 'run')} == {'000000', '000001', '000002'}
    record = json.loads((tmp_path / 'run' / 'metrics.json').read_text())
    assert sorted(record['losses']) == ['1', '2'] and record['final']


def _labelled(run: Path) -> list[tuple[str, str, str]]:
    return [(path.parent.name, path.stem, path.suffix) for path in (run / 'labels').glob('round_*/*.npz')]
