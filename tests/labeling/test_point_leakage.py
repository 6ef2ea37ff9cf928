"""Training sees the annotated points and nothing else: noise in all hidden labels changes no bit (METHOD 8).

The same runs show that a run killed while it renews its labels ends as an undisturbed one.
"""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from runs import tiny_runs, toy_runs

from rm3d_plugin.label_budgets import load_point_budget
from rm3d_plugin.storage import LabelStore


def run(folder: Path, **settings) -> tuple[int, str]:
    return tiny_runs.run(folder.with_suffix('.txt'), partial(toy_runs.train, folder, **settings))


@pytest.fixture(scope='module')
def drawn(tmp_path_factory) -> Path:
    """An undisturbed run on the true data."""
    folder = tmp_path_factory.mktemp('drawn') / 'run'
    code, log = run(folder)
    assert code == 0, log
    return folder


def assert_same_learning(folder: Path, other: Path) -> None:
    ours, theirs = (json.loads((f / 'metrics.json').read_text())['losses'] for f in (folder, other))
    assert ours == theirs and len(ours) == 4
    ours, theirs = (torch.load(f / 'epoch_4.pth', weights_only=True)['state_dict'] for f in (folder, other))
    for name in ours:
        assert torch.equal(ours[name], theirs[name]), name
    stored = sorted(path.relative_to(folder) for path in (folder / 'labels').rglob('*.npz'))
    rounds = [name for name in stored if name.parts[1] != 'kept']  # the prior of regions is kept beside them
    assert len(rounds) == 3 * 2 * 2 + 1  # labels and ledgers of three scenes in two rounds, and the budget
    for name in stored:
        assert (folder / name).read_bytes() == (other / name).read_bytes(), name


def test_the_run_reveals_few_points_and_learns_from_more(drawn):
    store, budget = LabelStore(drawn / 'labels'), load_point_budget(drawn / 'labels' / 'budget.json')
    assert budget.annotated_count == 3 * 5 and not budget.complete  # three boxes, floor, wall
    rounds = [store.summary(number) for number in store.rounds()]
    assert len(rounds) == 2 and 0.2 < rounds[0]['coverage'] <= rounds[1]['coverage']
    assert store.read('room0', 0).point_is_annotated.sum() == 5


@pytest.mark.parametrize('budget', [toy_runs.BUDGET, 'scenes20pct', '0p6pct_no_instances'])
def test_noise_in_hidden_labels_changes_nothing(drawn, tmp_path, budget):
    if budget == toy_runs.BUDGET:
        clean = drawn
    else:
        clean = tmp_path / 'clean'
        code, log = run(clean, budget=budget)
        assert code == 0, log
    change = partial(toy_runs.with_noise, clean / 'labels' / 'budget.json', 'no_instances' not in budget)
    code, log = run(tmp_path / 'run', budget=budget, change=change)
    assert code == 0, log
    if budget == 'scenes20pct':
        assert len(list((clean / 'labels').rglob('ledger/*.npz'))) == 4  # none of the complete scene
        for name in ('round_000/room0.npz', 'round_001/room1.npz', 'round_001/room2.npz'):
            ours, theirs = ((f / 'labels' / name).read_bytes() for f in (tmp_path / 'run', clean))
            assert ours == theirs
    else:
        assert_same_learning(tmp_path / 'run', clean)
        summaries = [LabelStore(folder / 'labels').summary(1) for folder in (tmp_path / 'run', clean)]
        assert summaries[0] != summaries[1], 'the report must have met the noise, or this test proves nothing'
    losses = [json.loads((f / 'metrics.json').read_text())['losses'] for f in (tmp_path / 'run', clean)]
    assert losses[0] == losses[1] and np.isfinite([v for row in losses[0].values() for v in row.values()]).all()


def test_noise_in_hidden_labels_does_not_reach_the_prior_of_regions(tmp_path):
    clean, noisy = tmp_path / 'clean', tmp_path / 'noisy'
    code, log = run(clean, region_prior=True)
    assert code == 0, log
    change = partial(toy_runs.with_noise, clean / 'labels' / 'budget.json')
    code, log = run(noisy, region_prior=True, change=change)
    assert code == 0, log
    assert_same_learning(noisy, clean)
    assert LabelStore(clean / 'labels').summary(1) != LabelStore(noisy / 'labels').summary(1)


def test_other_annotated_points_change_the_run(drawn, tmp_path):
    """The other way round: what is annotated does reach training."""
    code, log = run(tmp_path / 'run', budget='20pts')
    assert code == 0, log
    ours, theirs = (json.loads((f / 'metrics.json').read_text())['losses'] for f in (tmp_path / 'run', drawn))
    assert ours != theirs


@pytest.mark.parametrize(
    ('moment', 'round_one', 'resumed'),
    [
        ({'kill_at_refresh': 5}, False, 2),
        ({'kill_at_iteration': 2}, False, 0),  # in the first epoch, before any checkpoint
        ({'kill_at_iteration': 5}, False, 1),  # in the second epoch on the first labels
        ({'kill_at_iteration': 8}, True, 2),  # in the first epoch on the new labels
    ],
    ids=['refresh', 'epoch 1', 'epoch 2', 'epoch 3'],
)
def test_a_killed_run_ends_as_an_undisturbed_one(drawn, tmp_path, moment, round_one, resumed):
    code, log = run(tmp_path / 'run', **moment)
    assert code == -9, log
    assert LabelStore(tmp_path / 'run' / 'labels').is_complete(1) == round_one
    code, log = run(tmp_path / 'run', resume=True)
    assert code == 0, log
    assert ('training starts from scratch' in log) == (resumed == 0) and (f'resumed epoch: {resumed}' in log) == (
        resumed > 0
    )
    assert_same_learning(tmp_path / 'run', drawn)
    assert (tmp_path / 'run' / 'metrics.json').read_bytes() == (drawn / 'metrics.json').read_bytes()
    ours, theirs = (torch.load(f / 'epoch_4.pth', weights_only=True)['optimizer'] for f in (tmp_path / 'run', drawn))
    for number, state in ours['state'].items():
        assert all(torch.equal(state[key], theirs['state'][number][key]) for key in state)
