import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import log_softmax

from rm3d_plugin.pseudo_labels.propagation import network
from rm3d_plugin.pseudo_labels.propagation.estimate import USUAL
from rm3d_plugin.pseudo_labels.propagation.network import LEAST, likeliest_powers, weigh_network, with_network
from rm3d_plugin.pseudo_labels.propagation.rules import SILENT, NetworkSay


def witness(classes, right, generator, sure=0.8, of=3):
    """What a witness says who is right so often, each time on its own account."""
    named = np.where(
        generator.random(len(classes)) < right, classes, (classes + generator.integers(1, of, len(classes))) % of
    )
    out = np.full((len(classes), of), (1 - sure) / (of - 1))
    out[np.arange(len(classes)), named] = sure
    return out


def two_witnesses(labels=600, right=0.8, seed=0):
    generator = np.random.default_rng(seed)
    classes = np.arange(labels) % 3
    return witness(classes, 0.8, generator), witness(classes, right, generator), classes, np.ones(3)


def accuracy(shares, classes):
    return np.mean(shares.argmax(axis=1) == classes)


def test_of_two_witnesses_that_err_apart_both_together_are_right_more_often():
    walked, said, classes, found = two_witnesses()
    walked[:, 0] += 0.05  # no ties where they differ
    walked /= walked.sum(axis=1, keepdims=True)
    say = weigh_network(walked, said, classes, found, errors_apart=2.0)
    assert say.weight > 0 and say.labels == len(classes)
    both = with_network(walked, said, say)
    assert accuracy(both, classes) >= max(accuracy(walked, classes), accuracy(said, classes))
    better = witness(classes, 0.95, np.random.default_rng(5))
    say = weigh_network(walked, better, classes, found, errors_apart=2.0)
    assert say.weight > say.own
    assert accuracy(with_network(walked, better, say), classes) > accuracy(walked, classes) + 0.1


@pytest.mark.parametrize('right', [1 / 3, 0.1])
def test_a_witness_by_chance_or_one_that_is_mostly_wrong_has_no_say(right):
    for seed in range(5):
        walked, said, classes, found = two_witnesses(labels=90, right=right, seed=seed)
        assert weigh_network(walked, said, classes, found, errors_apart=2.0) == SILENT._replace(labels=90)


def test_an_echo_of_the_walk_has_no_say():
    walked, _, classes, found = two_witnesses(labels=90)
    assert weigh_network(walked, walked, classes, found, errors_apart=1.0).weight == 0


def test_powers_are_the_likeliest_that_a_search_without_gradients_finds():
    walked, said, classes, _ = two_witnesses(labels=60)
    logs, weight = np.log(np.stack([walked, said])), np.linspace(0.5, 1.5, 60)

    def loss(powers):
        pooled = log_softmax(powers[0] * logs[0] + powers[1] * logs[1], axis=1)
        likely = sum(w * row[c] for w, row, c in zip(weight, pooled, classes, strict=True))
        return (powers[0] - USUAL) ** 2 + powers[1] ** 2 - likely

    expected = minimize(loss, [1.0, 1.0], method='Nelder-Mead', options={'xatol': 1e-6, 'fatol': 1e-10}).x
    np.testing.assert_allclose(likeliest_powers(logs, classes, weight), expected, atol=1e-4)


def test_few_labels_leave_the_powers_as_they_usually_are():
    walked, said, classes, _ = two_witnesses(labels=600)
    logs = np.log(np.stack([walked, said]))
    away = [
        np.abs(likeliest_powers(logs[:, :rows], classes[:rows], np.ones(rows)) - [USUAL, 0]).sum() for rows in (1, 600)
    ]
    assert away[0] < 0.5 * away[1]
    assert weigh_network(walked[:1], said[:1], classes[:1], np.ones(3), 1.0).weight == 0


def test_both_together_are_as_sure_of_themselves_as_the_walk_alone():
    walked, said, classes, found = two_witnesses(labels=3000)
    say = weigh_network(walked, said, classes, found, errors_apart=2.0)
    alone = likeliest_powers(np.log(walked)[None], classes, np.ones(len(classes)))[0]
    both = with_network(walked, said, say) ** alone
    both /= both.sum(axis=1, keepdims=True)
    assert both.max(axis=1).mean() == pytest.approx(accuracy(both, classes), abs=0.03)


def test_the_answer_is_the_product_of_powers_and_where_the_network_saw_nothing_the_walk():
    shares = np.array([[0.7, 0.2, 0.1], [0.5, 0.5, 0.0], [0.1, 0.1, 0.8]])
    said = np.array([[0.2, 0.6, 0.2], [0.1, 0.1, 0.8], [np.nan] * 3])
    found = with_network(shares, said, NetworkSay(weight=2.0, own=0.5, labels=9))
    product = shares[0] ** 0.5 * said[0] ** 2
    np.testing.assert_allclose(found[0], product / product.sum())
    np.testing.assert_array_equal(found[2], shares[2])
    small = np.array([0.5, 0.5, LEAST]) ** 0.5 * said[1] ** 2
    np.testing.assert_allclose(found[1], small / small.sum(), rtol=2e-3)
    assert found[1].argmax() == 2  # what the walk rules out the network may still name


def test_a_network_that_names_few_classes_is_not_judged_by_labels_of_these_alone():
    generator = np.random.default_rng(1)
    for judged in (1, 2):
        classes = np.arange(60) % judged
        walked = witness(classes, 0.8, generator, of=5)
        said = np.full((60, 5), 0.01)
        said[np.arange(60), classes] = 0.96
        assert weigh_network(walked, said, classes, np.ones(5), errors_apart=1.64).weight == 0
        assert (weigh_network(walked, said, classes, np.r_[9.0, 9.0, 1, 1, 1], 1.64).weight > 0) == (judged == 2)


def test_large_scans_are_worked_on_in_blocks(monkeypatch):
    walked, said, _, _ = two_witnesses(labels=60)
    said[::7] = np.nan
    walked, said = walked.astype(np.float32), said.astype(np.float32)
    whole = with_network(walked, said, NetworkSay(1.5, 0.8, 9))
    monkeypatch.setattr(network, 'BLOCK', 11)
    np.testing.assert_array_equal(with_network(walked, said, NetworkSay(1.5, 0.8, 9)), whole)
    assert whole.dtype == np.float32
