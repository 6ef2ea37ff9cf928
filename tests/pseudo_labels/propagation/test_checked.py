import numpy as np
import pytest
from steps_scene import clicks, scene

from rm3d_plugin.pseudo_labels.propagation import Beside, WalkerRules, examples_of, prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.checked import (
    CheckedLabels,
    check_labels,
    estimate_across,
    joined,
    sharpness_of,
)
from rm3d_plugin.pseudo_labels.propagation.estimate import calibrated


def answers(rng, count, power):
    """Probabilities that are right as often as they say once they are raised to a power, and classes drawn so."""
    true = rng.dirichlet([0.6, 0.6, 0.6], count)
    classes = np.array([rng.choice(3, p=row) for row in true])
    return calibrated(true, 1.0 / power).astype(np.float64), classes


@pytest.mark.parametrize('power', [0.5, 1.0, 2.0, 4.0])
def test_probabilities_become_right_as_often_as_they_say(power):
    shares, classes = answers(np.random.default_rng(0), 4000, power)
    found = sharpness_of(CheckedLabels(shares, classes, np.bincount(shares.argmax(axis=1), minlength=3) * 1.0))
    assert abs(np.log2(found / power)) <= 0.26  # a step of the powers that are tried


def test_an_estimate_holds_what_is_true():
    rng = np.random.default_rng(1)
    shares, classes = answers(rng, 3000, 2.0)
    left = CheckedLabels(shares[:300], classes[:300], np.bincount(shares.argmax(axis=1), minlength=3) * 1.0)
    said = shares[300:].argmax(axis=1)
    hit = [np.sum((said == c) & (classes[300:] == c)) / np.sum((said == c) | (classes[300:] == c)) for c in range(3)]
    found = estimate_across(shares[300:], left, 200, rng)
    assert found.low <= 100 * np.mean(hit) <= found.high
    assert abs(found.miou - 100 * np.mean(hit)) < 8 and found.labels == 300


def test_no_estimate_from_few_labels():
    left = CheckedLabels(np.full((2, 3), 1 / 3), np.array([0, 1]), np.ones(3))
    assert estimate_across(np.full((5, 3), 1 / 3), left, 10, np.random.default_rng(0)) is None


def test_a_class_with_one_label_is_known_from_other_scans():
    cloud, semantic = scene(seed=1)
    lent = examples_of(prepare_cloud(cloud), clicks(semantic, 20))
    here, there = scene(seed=2)
    annotated = clicks(there, 1)
    beside = Beside(*lent, possible=np.ones(3, dtype=bool))
    checked = check_labels(prepare_cloud(here), annotated, 3, WalkerRules(), beside)
    assert len(checked.classes) == 3 and np.allclose(checked.shares.sum(axis=1), 1.0)
    assert (checked.shares.argmax(axis=1) == checked.classes).sum() >= 2
    both = joined([checked, checked])
    assert len(both.classes) == 6 and np.array_equal(both.found, 2 * checked.found)
