"""Outputs never replace inputs, by whatever name."""

import errno
import os

import numpy as np
import pytest
from runs.random_segmentor import make_checkpoint, make_scan

from rm3d_plugin.engine.config import ConfigError
from rm3d_plugin.engine.work_dir import check_folder
from rm3d_plugin.inference.outputs import check_targets
from rm3d_plugin.inference.oversegment import oversegment_file
from rm3d_plugin.inference.predict import predict_files
from rm3d_plugin.storage.files import atomic_write


def test_the_same_file_by_path_link_or_inode(tmp_path):
    scan = tmp_path / 'a.ply'
    scan.write_text('scan')
    (tmp_path / 'link.ply').symlink_to(scan)
    os.link(scan, tmp_path / 'hard.ply')
    (tmp_path / 'folder').symlink_to(tmp_path, target_is_directory=True)
    for name in ('a.ply', 'link.ply', 'hard.ply', 'folder/a.ply'):
        with pytest.raises(ConfigError, match=f'--out OUT: .* would be written over the input {scan}'):
            check_targets([tmp_path / 'b.ply', tmp_path / name], [scan], 'OUT')
    check_targets([tmp_path / 'b.ply', tmp_path / 'absent' / 'a.ply'], [scan, tmp_path / 'gone.ply'], 'OUT')


def test_a_folder_that_is_a_file(tmp_path):
    (tmp_path / 'file').write_text('')
    check_folder(tmp_path / 'new' / 'folder')
    for path in (tmp_path / 'file', tmp_path / 'file' / 'below'):
        with pytest.raises(ConfigError, match='file is a file; name a folder'):
            check_folder(path)


def test_a_folder_that_is_read_only(tmp_path, monkeypatch):
    monkeypatch.setattr(os, 'access', lambda path, mode: path != tmp_path)
    with pytest.raises(ConfigError, match=rf'--out .*: {tmp_path} is read-only; name another folder'):
        check_folder(tmp_path / 'new')


def test_a_full_disk_is_told_with_the_file(tmp_path):
    def write(file):
        raise OSError(errno.ENOSPC, 'No space left on device')

    (tmp_path / 'a.npz').write_text('old')
    with pytest.raises(OSError, match='No space left on device') as caught:
        atomic_write(tmp_path / 'a.npz', write)
    assert caught.value.filename == str(tmp_path / 'a.npz')
    assert [path.name for path in tmp_path.iterdir()] == ['a.npz'] and (tmp_path / 'a.npz').read_text() == 'old'


def test_predict_and_oversegment_spare_their_inputs(tmp_path):
    checkpoint, scan = make_checkpoint(tmp_path / 'net.pth'), make_scan(tmp_path / 'a.ply')
    before = scan.read_bytes()
    with pytest.raises(ConfigError, match='a.ply would be written over the input'):
        list(predict_files(checkpoint, [scan], tmp_path))
    with pytest.raises(ConfigError, match='a.ply would be written over the input'):
        oversegment_file(scan, scan)
    np.savez(tmp_path / 'b.npz', xyz=np.eye(3))
    (tmp_path / 'out.npz').symlink_to(tmp_path / 'b.npz')
    with pytest.raises(ConfigError, match='out.npz would be written over the input'):
        oversegment_file(tmp_path / 'b.npz', tmp_path / 'out.npz')
    assert scan.read_bytes() == before
