import numpy as np
import pytest
from steps_scene import clicks, scene

from rm3d_plugin.pseudo_labels.propagation import Beside, WalkerRules, examples_of, prepare_cloud
from rm3d_plugin.pseudo_labels.propagation.checked import (
    CheckedLabels,
    check_labels,
    joined,
    sharpness_of,
)
from rm3d_plugin.pseudo_labels.propagation.estimate import calibrated
from rm3d_plugin.pseudo_labels.propagation.scores import painted, shown


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


def test_a_stroke_is_checked_as_one_label():
    cloud, semantic = scene(seed=1)
    annotated = clicks(semantic, 3)
    stroke = painted(cloud.xyz, semantic, np.flatnonzero(annotated == 0)[:1], 0.3)
    drawn = shown(semantic, np.union1d(stroke, np.flatnonzero(annotated >= 0)))
    prepared = prepare_cloud(cloud)
    checked = check_labels(prepared, drawn, 3, WalkerRules(), Beside())
    assert len(stroke) > 10 and np.bincount(checked.classes).tolist() == [3, 3, 3]


def test_without_a_labelled_class_among_the_answers_the_usual_power_holds():
    left = CheckedLabels(np.eye(2)[[0, 0, 0]], np.array([1, 1, 1]), np.array([9.0, 0.0]))
    assert sharpness_of(left) == 2.0
