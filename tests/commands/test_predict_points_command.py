"""The prediction command with a segmentor."""

import numpy as np
from runs.random_segmentor import make_checkpoint, make_scan

from rm3d_plugin.commands.test import metric_table
from rm3d_plugin.engine.run import Evaluation
from rm3d_plugin.storage.scans import read_scan


def test_a_folder_of_scans_becomes_classes(call, tmp_path):
    network, scans, out = make_checkpoint(tmp_path / 'net.pth', instances=True), tmp_path / 'scans', tmp_path / 'out'
    for seed, name in enumerate(('a', 'b')):
        make_scan(scans / f'{name}.ply', seed=seed, shift=(4e5, 5e6, 100.0))
    (scans / 'notes.md').write_text('no scan')
    options = ['--tta-rotations', '2', '--flip', 'both', '--chunk', '2.5', '--unknown-below', '.4', '--min-score', '.1']
    code, output = call('predict', network, scans, '--out', out, *options)
    assert code == 0, output
    lines = [line for line in output.splitlines() if line.startswith(str(out))]
    assert lines == [str(out / 'a.ply'), str(out / 'b.ply')]
    found, source = read_scan(out / 'a.ply', labels=True), read_scan(scans / 'a.ply')
    assert set(found.label.tolist()) <= {-1, 0, 1, 2} and len(found.instance) == 300
    np.testing.assert_allclose(
        found.cloud.xyz + found.cloud.origin, source.cloud.xyz + source.cloud.origin, atol=1e-4, rtol=0
    )


def test_what_the_user_can_mend_is_told(call, tmp_path):
    network, scan = make_checkpoint(tmp_path / 'net.pth'), make_scan(tmp_path / 'a.ply')
    code, output = call('predict', network, scan, '--out', tmp_path / 'out', '--format', 'semantic3d')
    assert code == 2 and "the network knows the class 'ground', which is not one of man-made terrain" in output
    assert 'Traceback' not in output and not (tmp_path / 'out').exists()


def test_options_of_points_are_not_for_boxes(call, trained, world, tmp_path):
    checkpoint = max(trained.glob('epoch_*.pth'))
    scan = world / 'training' / 'velodyne' / '000001.bin'
    code, output = call('predict', checkpoint, scan, '--out', tmp_path / 'out', '--tta-rotations', '4')
    assert code == 2 and 'finds boxes; tta_rotations is for networks that classify points' in output


def test_scores_of_points_are_printed_as_they_are():
    table = metric_table(Evaluation({'mIoU': 61.234, 'IoU_wall': float('nan')}, ()))
    assert table.splitlines()[2:] == ['mIoU      61.23', 'IoU_wall    nan']
