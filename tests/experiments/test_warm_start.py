"""Commands that are forked from a process that has imported the package."""

import threading

from rm3d_plugin.experiments import warm_start
from rm3d_plugin.experiments.run_commands import RM3D
from rm3d_plugin.experiments.runner import alone
from rm3d_plugin.experiments.warm_start import KILLED, WarmStart

QUICK = 'from rm3d_plugin.experiments import warm_start; warm_start.IMPORTED = (); '


def test_commands_are_forked_and_tell_their_exit_codes(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(warm_start, 'SERVER', QUICK + warm_start.SERVER)
    with alone(tmp_path, print, threading.Event()) as lock, WarmStart() as start:
        words = (['--version'], ['train', 'no'])
        codes = [start.run([*RM3D, *each], tmp_path / f'{each[0]}.log', lock) for each in words]
        first = start._process
        assert start.run(['sh', '-c', 'echo said; exit 3'], tmp_path / 'other.log', lock) == 3
        helps = [([*RM3D, '--help'], tmp_path / f'{name}.log', lock) for name in 'ab']
        threads = [threading.Thread(target=start.run, args=arguments) for arguments in helps]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert codes == [0, 2] and start._process is first and first.poll() == 0
    assert (tmp_path / '--version.log').read_text().startswith('rm3d_plugin ')
    assert 'error: ' in (tmp_path / 'train.log').read_text() and (tmp_path / 'other.log').read_text() == 'said\n'
    assert (tmp_path / 'a.log').read_text() == (tmp_path / 'b.log').read_text() != ''
    assert capfd.readouterr().err == ''


def test_a_process_that_ends_without_a_word_has_failed(tmp_path, monkeypatch):
    monkeypatch.setattr(warm_start, 'SERVER', 'raise SystemExit(1)')
    with alone(tmp_path, print, threading.Event()) as lock, WarmStart() as start:
        assert start.run([*RM3D, 'info'], tmp_path / 'log', lock) == KILLED
