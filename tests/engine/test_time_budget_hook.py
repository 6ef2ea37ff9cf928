"""Training stops after the epoch in which its time is over."""

import time
from types import SimpleNamespace

import pytest

from rm3d_plugin.engine.hooks import TimeBudgetHook


def epochs_until_stop(hook, most):
    runner = SimpleNamespace(max_epochs=most, train_loop=SimpleNamespace(stop_training=False))
    hook.before_train(runner)
    for epoch in range(most):
        if runner.train_loop.stop_training:
            return epoch
        hook.after_train_epoch(runner)
    hook.after_train(runner)
    return most


def test_all_epochs_where_there_is_time():
    assert epochs_until_stop(TimeBudgetHook(60.0), 5) == 5


def test_one_epoch_where_the_time_is_over(monkeypatch):
    hook = TimeBudgetHook(60.0)
    now = time.monotonic()
    monkeypatch.setattr(time, 'monotonic', lambda: now + 61.0)
    assert epochs_until_stop(hook, 5) == 1


def test_no_time_is_told():
    with pytest.raises(ValueError, match='TimeBudgetHook.seconds: expected a number > 0, got 0'):
        TimeBudgetHook(0)
