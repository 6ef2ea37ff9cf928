"""The folder of a run: whose files are removed, who may work in it, what a resumed run must share."""

import os
import subprocess
import sys

import pytest
import torch
from mmengine.config import Config

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.work_dir import (
    check_same_settings,
    choose_checkpoint,
    lock_work_dir,
    plain_settings,
    take_over,
)
from rm3d_plugin.storage.files import write_text
from rm3d_plugin.storage.locks import LOCK, FolderInUseError
from rm3d_plugin.storage.written_files import MANIFEST, written_files


def config(work_dir, **changes):
    parts = dict(
        work_dir=str(work_dir), threads=1, sigma=2, model=dict(type='Net', widths=[8, 16], store=f'{work_dir}/labels'),
        train_dataloader=dict(num_workers=0, batch_size=2), val_dataloader=dict(batch_size=1),
        custom_hooks=[dict(type='ReportHook', train_scenes=3)],
    )  # fmt: skip
    return Config(parts | changes)


def test_only_what_a_run_wrote_is_removed(tmp_path):
    take_over(tmp_path, {}, clear=True)
    write_text(tmp_path / 'epoch_1.pth', 'weights')
    write_text(tmp_path / 'labels' / 'round_000' / 'a.npz', 'labels')
    (tmp_path / 'labels' / 'clicks.csv').write_text('mine')
    (tmp_path / 'epoch_2.pth').write_text('of somebody else')
    (tmp_path / '.epoch_3.pth.1.ab.tmp').write_text('half')
    assert sorted(written_files(tmp_path)) == ['epoch_1.pth', 'labels/round_000/a.npz', 'settings.json']
    take_over(tmp_path, {'sigma': 1}, clear=True)
    left = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob('*') if path.is_file())
    assert left == ['epoch_2.pth', 'labels/clicks.csv', 'settings.json', MANIFEST]
    assert not (tmp_path / 'labels' / 'round_000').exists()


def test_a_manifest_leads_nowhere_else(tmp_path):
    (tmp_path / 'outside').write_text('mine')
    folder = tmp_path / 'run'
    folder.mkdir()
    (folder / MANIFEST).write_text(f'../outside\n{tmp_path}/outside\n')
    take_over(folder, {}, clear=True)
    assert (tmp_path / 'outside').read_text() == 'mine'


def test_a_work_dir_with_checkpoints_is_refused_unless_told(tmp_path):
    assert choose_checkpoint(tmp_path, resume=False, overwrite=False) is None
    torch.save({'state_dict': {}}, tmp_path / 'epoch_4.pth')
    with pytest.raises(ConfigError, match='epoch_4.pth: no run of this version wrote it'):
        choose_checkpoint(tmp_path, resume=False, overwrite=True)
    (tmp_path / MANIFEST).write_text('epoch_4.pth\n')
    with pytest.raises(ConfigError, match=r'holds 1 checkpoints of a run \(epoch_4.pth\); go on with --resume'):
        choose_checkpoint(tmp_path, resume=False, overwrite=False)
    assert choose_checkpoint(tmp_path, resume=False, overwrite=True) is None
    assert choose_checkpoint(tmp_path, resume=True, overwrite=False) == tmp_path / 'epoch_4.pth'


def test_one_run_at_a_time(tmp_path):
    hold = (
        'import sys; from rm3d_plugin.storage.locks import folder_lock\n'
        'with folder_lock(sys.argv[1]): print("held", flush=True); sys.stdin.read()'
    )
    process = subprocess.Popen(
        [sys.executable, '-c', hold, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdout.readline() == 'held\n'
        with pytest.raises(FolderInUseError, match=f'process {process.pid} on .* works there'), lock_work_dir(tmp_path):
            pass
        process.kill()
        process.wait()
        assert (tmp_path / LOCK).is_file()  # what the dead one left counts for nothing
        with lock_work_dir(tmp_path):
            assert (tmp_path / LOCK).read_text().split()[0] == str(os.getpid())
    assert not (tmp_path / LOCK).exists()


def test_a_resumed_run_keeps_its_settings(tmp_path):
    check_same_settings(tmp_path, plain_settings(config(tmp_path)))  # nothing is known of a run of an older version
    take_over(tmp_path, plain_settings(config(tmp_path)), clear=True)
    moved = tmp_path / 'moved'
    moved.mkdir()
    (tmp_path / 'settings.json').rename(moved / 'settings.json')
    free = dict(
        threads=4, train_dataloader=dict(num_workers=2, batch_size=2), val_dataloader=dict(batch_size=4),
        custom_hooks=[dict(type='ReportHook', train_scenes=0)],
    )  # fmt: skip
    check_same_settings(moved, plain_settings(config(moved, **free)))
    changed = config(moved, sigma=3, train_dataloader=dict(num_workers=0, batch_size=4))
    with pytest.raises(ConfigError, match='sigma: 2 then, 3 now; train_dataloader.batch_size: 2 then, 4 now'):
        check_same_settings(moved, plain_settings(changed))
