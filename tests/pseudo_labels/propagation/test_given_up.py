"""Long work ends early where nobody waits for it any more."""

from threading import Barrier, get_ident

import numpy as np
import pytest
from numba import config
from steps_scene import clicks, scene

from rm3d_plugin.ops._parallel import map_blocks
from rm3d_plugin.pseudo_labels.propagation import prepare_cloud, propagate_prepared
from rm3d_plugin.pseudo_labels.propagation.given_up import GivenUpError, given_up_if, still_wanted


def test_work_goes_on_until_it_is_not_wanted():
    asked = []
    still_wanted()
    with given_up_if(lambda: len(asked) == 2):
        for number in range(2):
            still_wanted()
            asked.append(number)
        with pytest.raises(GivenUpError):
            still_wanted()
    still_wanted()


def test_threads_that_help_ask_the_same(monkeypatch):
    monkeypatch.setattr(config, 'NUMBA_NUM_THREADS', 2)
    both = Barrier(2, timeout=30)

    def work(first, _):
        both.wait()  # each in a thread of its own
        with pytest.raises(GivenUpError):
            still_wanted()
        return get_ident()

    with given_up_if(lambda: True):
        assert len(set(map_blocks(work, 2, 1))) == 2


def test_a_propagation_asks_on_its_way_and_leaves_nothing_behind():
    cloud, semantic = scene()
    scan, annotated = prepare_cloud(cloud), clicks(semantic, 8)
    whole, asked = propagate_prepared(scan, annotated, 3), []
    with given_up_if(lambda: asked.append(0) or False):
        np.testing.assert_array_equal(propagate_prepared(scan, annotated, 3).probabilities, whole.probabilities)
    for after in (0, len(asked) // 2, len(asked) - 1):
        left = iter(range(after))
        with given_up_if(lambda left=left: next(left, None) is None), pytest.raises(GivenUpError):
            propagate_prepared(scan, annotated, 3)
    assert len(asked) > 30  # folds, candidates and steps of conjugate gradients
    np.testing.assert_array_equal(propagate_prepared(scan, annotated, 3).probabilities, whole.probabilities)
