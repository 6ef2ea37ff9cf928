"""``rm3d inspect_merges`` on the labels of a small run."""


def test_ledger_and_replay_of_a_trained_run(trained, call):
    code, text = call(
        'inspect_merges', '--labels', trained / 'labels', '--round', 0, '--ledger', 2, '--replay', 'tau=.9'
    )
    assert code == 0, text
    assert 'strongest merges' in text and 'weakest merges' in text
    assert 'all: merges' in text and '->' in text


def test_what_is_wrong_is_told(trained, call, tmp_path):
    for arguments, message in (
        ((), 'nothing to do'),
        (('--replay', 'gama=1'), 'gama: is no threshold or switch'),
        (('--ledger', '--round', 99), 'round 99'),
        (('--replay', 'tau=.7', '--config', tmp_path / 'none.py'), 'no such file'),
    ):
        code, text = call('inspect_merges', '--labels', trained / 'labels', *arguments)
        assert code == 2 and message in text
