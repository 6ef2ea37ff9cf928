"""The cost model on costs that are known by a formula, and what it says of a data set, by hand."""

import argparse

import pytest

from rm3d_plugin.experiments.benchmarks import cost_model
from rm3d_plugin.experiments.benchmarks.cost_model import (
    GROWTH,
    PHASES,
    CostModel,
    Workload,
    check,
    fit,
    mean_phases,
    phases_of,
    project,
)


def costs(points, crop=1000):
    """Made-up costs: labels N log2 N, steps linear up to the crop, memory linear."""
    import math

    seen = min(points, crop)
    return {
        'labels, round 0': {'cpu_s': 2 + 1e-3 * points * math.log2(points), 'peak_mb': 300 + 0.5 * points},
        'step': {'cpu_s': 0.1 + 1e-3 * seen, 'peak_mb': 400 + 0.1 * seen},
        'labels, round 1': {'cpu_s': 5e-3 * points, 'peak_mb': 300 + 0.2 * points},
        'prediction': {'cpu_s': 1.0, 'peak_mb': 350.0},
    }


def test_known_costs_are_found_again_and_hold_for_an_unseen_size():
    model = fit({size: costs(size) for size in (100, 300, 1000, 3000, 10000)}, crop=1000)
    assert model.weights['labels, round 0', 'cpu_s'] == pytest.approx((2, 0, 1e-3), abs=1e-6)
    assert model.weights['labels, round 1', 'peak_mb'] == pytest.approx((300, 0.2))
    assert all(weight >= 0 for weights in model.weights.values() for weight in weights)
    told = check(model, 5000, costs(5000))
    assert set(told) == {f'{phase}, {what}' for phase in PHASES for what in GROWTH} | {'all phases, cpu_s'}
    assert all(abs(entry['off_percent']) < 0.5 for entry in told.values())
    assert model.cost('step', 'cpu_s', 10**6) == pytest.approx(1.1)  # no more than the crop
    assert check(model, 5000, {**costs(5000), 'prediction': {'cpu_s': 2.0, 'peak_mb': 350.0}})['prediction, cpu_s'][
        'off_percent'
    ] == pytest.approx(-50, abs=0.5)
    busy = {phase: {**own, 'cpu_s': 1.5 * own['cpu_s']} for phase, own in costs(5000).items()}
    assert all(abs(entry['off_percent']) < 0.5 for entry in check(model, 5000, busy, 1.5).values())
    with pytest.raises(ValueError, match='two sizes or more'):
        fit({100: costs(100)}, 1000)


def test_a_data_set_by_hand():
    flat = {(phase, 'cpu_s'): (float(number), 0.0, 0.0) for number, phase in enumerate(PHASES, 1)}
    flat |= {(phase, 'peak_mb'): (100.0 * number, 0.0) for number, phase in enumerate(PHASES, 1)}
    told = project(CostModel(flat, 1000), Workload(scenes=36, points=5000, epochs=100, refreshes=3))
    assert told['core_hours'] == {'first labels': 0.0, 'training': 2.0, 'further labels': 0.1, 'prediction': 0.0}
    seconds = 36 * (1 + 2 * 100 + 3 * 2 + 4)
    assert told['hours'] == {'2 cores': round(seconds / 7200, 1), '64 cores': 0.1, '1024 cores': 0.1}
    assert told['process_mib'] == 400
    half_more = project(CostModel(flat, 1000, beside=1.5), Workload(36, 5000, 100, 3))
    assert half_more['core_hours']['training'] == 3.0 and half_more['process_mib'] == 400


def test_processes_beside_each_other_are_measured_together(monkeypatch):
    seen = []

    def measure(points, args, processes=1):
        seen.append((points, processes))
        times = 1.25 if processes > 1 else 1.0
        return {phase: {**own, 'cpu_s': times * own['cpu_s']} for phase, own in costs(points, 1000).items()}

    monkeypatch.setattr(cost_model, '_measure', measure)
    parser = argparse.ArgumentParser()
    cost_model.add_arguments(parser)
    words = '--sizes 100 1000 10000 --unseen 5000 --together 1000 --crop 1000'.split()
    told = cost_model.run(parser.parse_args(words))
    assert set(seen) == {(100, 1), (1000, 1), (10000, 1), (5000, 1), (1000, 2), (5000, 2)} and len(seen) == 6
    assert told['processes']['times the seconds'] == 1.25
    assert max(abs(entry['off_percent']) for entry in told['unseen, processes'].values()) < 5
    assert set(told['projections']) == set(cost_model.WORKLOADS)


def test_means_of_phases():
    first = {phase: {'cpu_s': 1.0, 'peak_mb': 100.0} for phase in PHASES}
    second = {phase: {'cpu_s': 2.0, 'peak_mb': 300.0} for phase in PHASES}
    assert mean_phases([first, second]) == {phase: {'cpu_s': 1.5, 'peak_mb': 200.0} for phase in PHASES}


def test_phases_of_the_large_scene():
    found = {name: {'cpu_s': float(i), 'peak_mb': 10 * i} for i, name in enumerate(
        ('labels, round 0', 'step 1', 'step 2', 'labels, round 1', 'step 3', 'prediction')
    )}  # fmt: skip
    assert {phase: own['cpu_s'] for phase, own in phases_of(found).items()} == {
        'labels, round 0': 0.0, 'step': 2.0, 'labels, round 1': 3.0, 'prediction': 5.0
    }  # fmt: skip
