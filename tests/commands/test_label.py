"""``rm3d label``: what is printed, what is written, and how it ends."""

import numpy as np

from rm3d_plugin.commands.main import run
from rm3d_plugin.storage.ply import read_ply


def write_scan(folder):
    """Two sheets, one over the other, as text, and clicks on both."""
    rng = np.random.default_rng(0)
    low, high = rng.uniform(0, 2, (2, 400, 3))
    low[:, 2], high[:, 2] = 0.0, 1.0
    np.savetxt(folder / 'sheets.txt', np.concatenate([low, high]), fmt='%.3f')
    rows = [f'sheets,{point},{"low" if point < 400 else "high"}' for point in range(0, 800, 50)]
    (folder / 'clicks.csv').write_text('\n'.join(['scene,index,class', *rows]))
    return np.repeat([1, 0], 400)  # classes in the order of their names


def test_a_folder_of_scans_and_its_clicks(tmp_path, capsys):
    semantic = write_scan(tmp_path)
    code = run('label', [str(tmp_path), '--clicks', str(tmp_path / 'clicks.csv'), '--out', str(tmp_path / 'out')])
    told = capsys.readouterr().out.splitlines()
    assert code == 0
    assert told[0].startswith('sheets.txt: 16 clicks (high 8, low 8) on 800 points, ')
    assert told[1] == '  rooms: the scan is 2 m long, up to 25 m are'
    assert 'from 16 of your clicks; method: ' in told[2]
    assert [line.strip() for line in told[3:]] == [
        str(tmp_path / 'out' / name) for name in ('sheets.ply', 'labels.json')
    ]
    assert (read_ply(tmp_path / 'out' / 'sheets.ply')['label'] == semantic).mean() > 0.97


def test_what_the_user_can_mend_ends_with_exit_code_2(tmp_path, capsys):
    write_scan(tmp_path)
    scan, clicks, out = (str(tmp_path / name) for name in ('sheets.txt', 'clicks.csv', 'out'))
    (tmp_path / 'wrong.csv').write_text('scene,index,class\nsheets,0,low\nroom,1,high\n')
    assert run('label', [scan, '--clicks', str(tmp_path / 'wrong.csv'), '--out', out]) == 2
    assert "wrong.csv line 3: scene 'room' is none of the scans: sheets" in capsys.readouterr().err
    assert run('label', [scan, '--labels', 'label', '--out', out]) == 2
    assert "no field 'label'" in capsys.readouterr().err
    assert run('label', [scan, '--clicks', clicks, '--out', out, '--format', 'semantickitti']) == 2
    assert "the class 'high'" in capsys.readouterr().err
    assert run('label', [scan, '--clicks', clicks, '--out', clicks]) == 2
    assert 'is a file; name a folder' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
