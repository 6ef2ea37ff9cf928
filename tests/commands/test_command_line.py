"""What a user meets at the command line: what can be mended is told in one message, with exit code 2."""

import re
import subprocess
import sys
import time

import pytest
import torch
from runs import tiny_runs

CONFIG = tiny_runs.CONFIG


def refused(result: tuple[int, str]) -> str:
    """The one message of a refusal."""
    code, output = result
    assert code == 2, output
    assert 'Traceback' not in output
    (message,) = [line for line in output.splitlines() if 'error:' in line]
    return message


def test_without_kitti_the_message_tells_where_it_was_looked_for_and_what_to_do(tmp_path):
    began, used = time.perf_counter(), sum(_child_seconds())
    command = [sys.executable, str(tiny_runs.ROOT / 'tools' / 'train.py'), str(CONFIG)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    seconds, used = time.perf_counter() - began, sum(_child_seconds()) - used
    assert done.returncode == 2
    assert f'error: KITTI was looked for at {tmp_path}/data/kitti' in done.stderr
    for word in ('ImageSets/', 'velodyne/', 'calib/', 'label_2/', 'data_root=FOLDER', '--demo', 'cvlibs.net'):
        assert word in done.stderr
    assert 'Traceback' not in done.stderr and 'mmengine' not in done.stdout + done.stderr
    assert min(seconds, used) < 10
    assert not list(tmp_path.iterdir()), 'nothing is left behind'


def _child_seconds() -> tuple[float, float]:
    import resource

    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime, usage.ru_stime


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        (['nonsense=1'], ['--cfg-options nonsense', 'no such key', 'data_root']),
        (['sigma=2', 'descripter.radius=1'], ['--cfg-options descripter.radius', 'no such key']),
        (['test_dataloader.batch_size=2'], ['test_dataloader.batch_size', 'reference']),
        (['rounds=0'], ['rounds: expected a whole number from 1, got 0']),
        (['budget=${nothing}'], ["budget: Interpolation key 'nothing' not found"]),
    ],
)
def test_bad_options(call, options, words):
    message = refused(call('train', CONFIG, '--cfg-options', *options))
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ('option', 'words'),
    [
        ('descriptor.type=Nonsense', ['Nonsense is not in the', 'descriptor registry']),
        ('descriptor.radus=1', ['radus']),
        ('merge.roundings=3', ['roundings']),
        ('model.backbone.width=3', ['width']),
        ('train_dataloader.dataset.splitt=val', ['splitt']),
        ('budget=99pct', ['99pct', '1pct']),
    ],
)
def test_misspelt_parts_and_settings(call, world, tmp_path, option, words):
    settings = tiny_runs.options(world)
    message = refused(call('train', *tiny_runs.arguments_of(settings, tmp_path / 'run'), option))
    for word in words:
        assert word in message


def test_bad_configs(call, tmp_path):
    assert 'absent.py: no such config' in refused(call('train', tmp_path / 'absent.py'))
    (tmp_path / 'broken.py').write_text('rounds = = 3')
    assert 'broken.py: cannot be read as a config' in refused(call('train', tmp_path / 'broken.py'))
    (tmp_path / 'bare.py').write_text('rounds = 3\nsigma = 1\n')
    assert 'no `demo` settings' in refused(call('train', tmp_path / 'bare.py', '--demo'))


def test_demo_does_not_write_into_a_folder_of_other_data(call, tmp_path):
    (tmp_path / 'mine').mkdir()
    (tmp_path / 'mine' / 'scan.bin').write_bytes(b'precious')
    message = refused(call('train', CONFIG, '--demo', '--cfg-options', f'data_root={tmp_path / "mine"}'))
    assert '--demo' in message and str(tmp_path / 'mine') in message
    assert [path.name for path in (tmp_path / 'mine').iterdir()] == ['scan.bin']


def test_the_other_commands_also_ask_for_kitti(call, trained):
    checkpoint = next(trained.glob('epoch_*.pth'))
    assert 'KITTI was looked for at' in refused(call('prepare', CONFIG))
    assert 'KITTI was looked for at' in refused(call('test', CONFIG, checkpoint))


def test_checkpoints_that_cannot_be_used(call, world, trained, tmp_path):
    absent, noise, other = (tmp_path / name for name in ('absent.pth', 'noise.pth', 'other.pth'))
    noise.write_bytes(bytes(range(256)) * 10)
    torch.save({'weight': torch.zeros(3)}, other)
    scan = world / 'training' / 'velodyne' / '000000.bin'
    for path, word in (
        (absent, 'absent.pth: no such checkpoint'),
        (noise, 'noise.pth: not a checkpoint that loads safely'),
        (other, 'other.pth: holds no weights'),
    ):
        assert word in refused(call('predict', path, scan, '--out', tmp_path / 'out'))
        assert word in refused(call('test', CONFIG, path, '--cfg-options', f'data_root={world}'))
    torch.save({'state_dict': {}, 'meta': {}}, other)
    assert 'other.pth: holds no config' in refused(call('predict', other, scan, '--out', tmp_path / 'out'))
    whole = next(trained.glob('epoch_*.pth'))
    message = refused(call('test', CONFIG, whole, '--cfg-options', f'data_root={world}'))
    assert 'its weights do not fit the model' in message
    noise.write_bytes(whole.read_bytes()[:-1000])
    assert 'not a checkpoint that loads safely' in refused(call('predict', noise, scan, '--out', tmp_path / 'out'))
    assert not (tmp_path / 'out').exists()


def test_scans_and_devices_that_cannot_be_used(call, trained, world, tmp_path):
    checkpoint, out = next(trained.glob('epoch_*.pth')), tmp_path / 'out'
    scan = world / 'training' / 'velodyne' / '000000.bin'
    assert 'absent.bin: no such file' in refused(call('predict', checkpoint, tmp_path / 'absent.bin', '--out', out))
    (tmp_path / 'cut.bin').write_bytes(scan.read_bytes()[:-3])
    assert 'cut.bin' in refused(call('predict', checkpoint, tmp_path / 'cut.bin', '--out', out))
    (tmp_path / 'nothing').mkdir()
    assert re.search(
        r'no .*\.ply .*\.xyz.* file in', refused(call('predict', checkpoint, tmp_path / 'nothing', '--out', out))
    )
    assert '--device gpu' in refused(call('predict', checkpoint, scan, '--out', out, '--device', 'gpu'))
    message = refused(call('predict', checkpoint, scan, '--out', out, '--device', 'cuda:9'))
    assert '--device cuda:9' in message and 'CUDA devices were found' in message


def test_a_demo_run_says_so_and_resuming_nothing_starts_anew(call, world, tmp_path):
    sizes = ['demo_data.num_train=3', 'demo_data.num_val=1', 'demo_data.seed=1', 'demo_data.azimuth_step=1.0']
    run = tmp_path / 'run'
    arguments = tiny_runs.arguments_of(tiny_runs.options(world, rounds=1), run)
    code, output = call('train', *arguments, *sizes, '--demo', '--resume')
    assert code == 0, output
    assert f'--resume: there is no epoch_*.pth in {run}; training starts from scratch' in output
    lines = output.splitlines()
    assert lines[0].startswith('Demo data: the scenes are synthetic') and lines[-2] == lines[0]
    assert lines[-1] == f'report: {run / "report.html"}' and (run / 'report.html').is_file()
    code, output = call('train', *arguments, *sizes, '--demo', '--resume')
    assert code == 0 and 'from scratch' not in output and 'resumed epoch: 1' in output
