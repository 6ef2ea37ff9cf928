"""Contrastive losses against values by hand, their gradients, and which places are drawn."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rm3d_plugin.models.batch import Batch
from rm3d_plugin.models.consistency import View
from rm3d_plugin.models.losses import PairContrast, hardest_contrastive_loss, info_nce_loss, pair_loss, triplet_loss
from rm3d_plugin.models.losses.pair_contrast import matched_share, sample_pairs

# Three places on a line; the first two are neighbours, the third lies apart from both.
ANCHORS = torch.tensor([[0.0, 0.0], [0.4, 0.0], [1.0, 0.0]], dtype=torch.float64)
POSITIVES = ANCHORS + torch.tensor([0.0, 0.3], dtype=torch.float64)
APART = torch.tensor([[0, 0, 1], [0, 0, 1], [1, 1, 0]], dtype=torch.bool)


def test_triplet_by_hand():
    # d_p = 0.3 each; apart: sqrt(1 + .09) and sqrt(.36 + .09), each once in either direction
    costs = np.array([0.3 - np.sqrt(1.09) + 0.7, 0.3 - np.sqrt(0.45) + 0.7] * 2)
    expected = costs[costs > 0].mean()
    assert (costs > 0).sum() == 2 and triplet_loss(ANCHORS, POSITIVES, APART, 0.7).item() == pytest.approx(expected)


def test_pair_loss_by_hand():
    far = np.array([np.sqrt(1.09), np.sqrt(0.45), np.sqrt(0.45)])
    expected = (3 * 0.09 + (np.maximum(1 - far, 0) ** 2).sum()) / 6
    assert pair_loss(ANCHORS, POSITIVES, APART).item() == pytest.approx(expected, abs=1e-9)


def test_hardest_contrastive_by_hand_and_its_two_forms():
    far = np.array([np.sqrt(1.09), np.sqrt(0.45), np.sqrt(0.45)])
    push = np.mean((1.4 - far) ** 2)  # both directions are alike here
    assert hardest_contrastive_loss(ANCHORS, POSITIVES, APART).item() == pytest.approx(push, abs=1e-9)  # .09 < .1
    wider = hardest_contrastive_loss(ANCHORS, POSITIVES, APART, positive_margin=0.05).item()
    assert wider - push == pytest.approx(0.04, abs=1e-9), 'the squared distance less the margin, not squared again'


def test_info_nce_by_hand():
    # Cosines: of the first place with its positive .8, with the others .6 and 0; the third lies apart from both.
    first = torch.tensor([[1.0, 0.0], [0.0, 2.0], [0.6, 0.8]], dtype=torch.float64)
    second = torch.tensor([[0.8, 0.6], [0.6, 0.8], [0.0, 1.0]], dtype=torch.float64)
    cosines = (first / first.norm(dim=1, keepdim=True)) @ second.T
    costs = []
    for table in (cosines.numpy(), cosines.T.numpy()):
        for row, column in ((0, [2]), (1, [2]), (2, [0, 1])):
            own, others = np.exp(table[row, row] / 0.5), np.exp(table[row, column] / 0.5).sum()
            costs.append(-np.log(own / (own + others)))
    assert info_nce_loss(first, second, APART, 0.5).item() == pytest.approx(np.mean(costs), abs=1e-6)


@pytest.mark.parametrize('loss', [triplet_loss, pair_loss, hardest_contrastive_loss, info_nce_loss])
def test_gradients_and_nothing_apart(loss):
    generator = torch.Generator().manual_seed(0)
    first, second = (torch.randn(5, 3, dtype=torch.float64, generator=generator).requires_grad_() for _ in range(2))
    apart = ~torch.eye(5, dtype=torch.bool)
    assert torch.autograd.gradcheck(lambda a, b: loss(a, b, apart), (first, second))
    nothing = loss(first, first, torch.zeros(5, 5, dtype=torch.bool))
    nothing.backward()
    assert nothing.item() == pytest.approx(0.0, abs=1e-9) and torch.isfinite(first.grad).all()
    assert loss(first[:0], first[:0], apart[:0, :0]).item() == 0.0


def batch_of(places, sizes, ids, view_sizes, features=None):
    """A batch of first crops, and one view whose features are given."""
    offsets = torch.tensor([0, *np.cumsum(sizes)])
    view = View(
        torch.zeros(len(ids), 3), torch.tensor([0, *np.cumsum(view_sizes)]), ids, lambda *_: features, lambda x: x
    )
    return Batch(places, offsets, (view,))


@given(st.integers(0, 1000), st.floats(0.5, 4.0))
@settings(deadline=None, max_examples=12)
def test_drawn_places_obey_their_distances(seed, least):
    rng = np.random.default_rng(seed)
    sizes = [40, 30]
    places = torch.from_numpy(rng.uniform(0, 5, (70, 3)).astype(np.float32))
    ids = torch.from_numpy(np.concatenate([rng.integers(-1, 40, 50), rng.integers(-1, 30, 20) + 0]))
    ids[50:] = torch.where(ids[50:] < 0, ids[50:], ids[50:] + 40)
    batch = batch_of(places, sizes, ids, [50, 20])
    pairs = sample_pairs(batch, batch.views[0], 30, least)
    assert len(pairs.first) == min(30, int((ids >= 0).sum()))
    assert torch.equal(ids[pairs.second], pairs.first) and (pairs.first >= 0).all()
    assert len(set(pairs.second.tolist())) == len(pairs.second)
    scene = (pairs.first >= 40).int()
    for i in range(len(pairs.first)):
        for j in range(len(pairs.first)):
            gap = (places[pairs.first[i]] - places[pairs.first[j]]).double().norm().item()
            if abs(gap - least) > 1e-5:
                assert bool(pairs.apart[i, j]) == (gap >= least or scene[i] != scene[j])
    again = sample_pairs(batch, batch.views[0], 30, least)
    assert torch.equal(again.second, pairs.second)


def test_matched_share_by_hand():
    apart = ~torch.eye(3, dtype=torch.bool)
    anchors = torch.tensor([[0.0], [1.0], [2.0]])
    assert matched_share(anchors, torch.tensor([[0.1], [1.6], [2.2]]), apart).item() == pytest.approx(1.0)
    assert matched_share(anchors, torch.tensor([[0.1], [1.9], [1.1]]), apart).item() == pytest.approx(1 / 3)


@pytest.mark.parametrize('contrast', ['triplet', 'pair', 'hardest', 'nce'])
def test_the_term_compares_copies(contrast):
    class Said:
        features = torch.eye(4)

    places = torch.arange(4.0)[:, None] * torch.tensor([20.0, 0.0, 0.0])
    ids = torch.tensor([2, -1, 0])
    values = PairContrast(contrast)(batch_of(places, [4], ids, [3], torch.eye(4)[[2, 3, 0]]), Said(), None)
    assert values['matched'] == 1.0 and values['loss_contrast'] < 0.01
    swapped = PairContrast(contrast)(batch_of(places, [4], ids, [3], torch.eye(4)[[0, 3, 2]]), Said(), None)
    assert swapped['matched'] == 0.0 and swapped['loss_contrast'] > 0.5
    assert PairContrast(contrast)(Batch(places, torch.tensor([0, 4])), Said(), None) == {}


def test_an_unknown_contrast_is_refused():
    with pytest.raises(ValueError, match='triplet, pair, hardest, nce'):
        PairContrast('soft')
