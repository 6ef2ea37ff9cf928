"""What rounds cost, kept beside the record of a run."""

import json

import pytest

from rm3d_plugin.engine.round_times import RoundTimes, Seconds, Stopwatch
from rm3d_plugin.visualization import RoundTime


def test_rounds_by_hand(tmp_path):
    times = RoundTimes(tmp_path)
    assert times.rounds() == [] and times.training(0) == Seconds()
    times.labels(0, Seconds(9.0, 8.0), Seconds(), Seconds())
    for epoch in (1, 2):
        times.epoch(epoch, 0, Seconds(20.0, 10.0))
    times.labels(1, Seconds(6.0, 3.0), Seconds(2.0, 1.0), Seconds(1.5, 1.0))
    assert times.rounds() == [RoundTime(0, 9.0, 0.0, 40.0, 0.4), RoundTime(1, 6.0, 2.0, 0.0, None, 1.5)]
    times.epoch(3, 1, Seconds(30.0, 20.0))
    assert times.rounds()[1] == RoundTime(1, 6.0, 2.0, 30.0, 0.15, 1.5)
    for number in (10, 2):
        times.labels(number, Seconds(1.0, 1.0), Seconds(), Seconds())
    assert [row.round for row in times.rounds()] == [0, 1, 2, 10]


def test_a_resumed_run_forgets_the_epochs_that_come_again(tmp_path):
    first = RoundTimes(tmp_path)
    first.labels(0, Seconds(9.0, 8.0), Seconds(), Seconds())
    for epoch in (1, 2, 3):
        first.epoch(epoch, epoch // 3, Seconds(20.0, 10.0))
    again = RoundTimes(tmp_path, epoch=2)
    assert again.training(0) == Seconds(40.0, 20.0) and again.training(1) == Seconds()
    assert again.rounds() == [RoundTime(0, 9.0, 0.0, 40.0, 0.4)]
    again.epoch(3, 1, Seconds(5.0, 5.0))
    assert list(json.loads((tmp_path / 'timing.json').read_text())['epochs']) == ['1', '2', '3']
    assert RoundTimes(tmp_path).rounds() == []  # a new run in the same folder


def test_a_stopwatch_runs():
    watch = Stopwatch()
    sum(range(100_000))
    first, second = watch.read(), watch.read()
    assert 0 < first.wall <= second.wall and 0 <= first.cpu <= second.cpu
    assert Seconds(1.0, 2.0).plus(Seconds(3.0, 4.0)).minus(Seconds(0.5, 2.0)) == pytest.approx((3.5, 4.0))
