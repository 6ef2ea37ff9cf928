"""VoteNet's loss against loops over proposals and boxes."""

import math

import numpy as np
import pytest
import torch

from rm3d_plugin.models import Batch, DetectorOutput
from rm3d_plugin.models.heads import BatchLabels, ProposalTargets, VoteOutput
from rm3d_plugin.models.heads.box_coder import BoxCode, BoxPrediction
from rm3d_plugin.models.losses import VoteNetLoss

PROPOSALS, BINS, CLASSES = 6, 3, 2


def cross_entropy(logits, kind):
    return math.log(sum(math.exp(v) for v in logits)) - logits[kind]


def smooth_l1(difference):
    return 0.5 * difference**2 if abs(difference) < 1 else abs(difference) - 0.5


def huber(a, b):
    return sum(smooth_l1(x - y) for x, y in zip(a, b, strict=True))


def made(seed=0):
    """Two scenes, four proposals and two boxes in the first, two proposals and a box without points in the second."""
    rng = np.random.default_rng(seed)
    values = dict(
        xyz=rng.normal(0, 2, (12, 3)),
        offsets=rng.normal(0, 1, (12, 3)),
        instance=np.array([0] * 4 + [1] * 2 + [-1] * 6),
        boxes=rng.normal(0, 2, (3, 7)),
        objectness=rng.normal(0, 1, (PROPOSALS, 2)),
        centers=rng.normal(0, 2, (PROPOSALS, 3)),
        bins=rng.normal(0, 1, (PROPOSALS, BINS)),
        turns=rng.normal(0, 2, (PROPOSALS, BINS)),
        sizes=rng.normal(0, 1, (PROPOSALS, CLASSES)),
        stretch=rng.normal(0, 2, (PROPOSALS, CLASSES, 3)),
        classes=rng.normal(0, 1, (PROPOSALS, CLASSES)),
        weights=rng.uniform(0, 1, PROPOSALS),
        is_object=np.array([1, 0, 1, 0, 0, 0]),
        positives=np.array([0, 2]),
        own=np.array([1, 0]),
        box_classes=np.array([1, 0, 1]),
        code_bins=np.array([2, 0]),
        code_turns=rng.normal(0, 1, 2),
        code_stretch=rng.normal(0, 1, (2, 3)),
    )
    return values


def slow(m, trust=(1.0, 1.0, 1.0)):
    """Every term by name, times 10; ``trust`` is that in each box's geometry."""
    counts = {0: 4, 1: 2}
    worth = [counts[i] ** -0.5 for i in m['instance'] if i >= 0]
    gaps = [
        np.abs(m['offsets'][p] - (m['boxes'][i, :3] - m['xyz'][p])).sum() for p, i in enumerate(m['instance']) if i >= 0
    ]
    # F.cross_entropy with class weights and reduction='none' multiplies each row by the weight of its class
    each = [(0.2, 0.8)[k] * cross_entropy(row, k) for row, k in zip(m['objectness'], m['is_object'], strict=True)]
    own = [huber(m['centers'][p], m['boxes'][b, :3]) for p, b in zip(m['positives'], m['own'], strict=True)]
    nearest = [min(huber(m['centers'][p], m['boxes'][b, :3]) for p in range(4)) for b in (0, 1)]
    kinds = m['box_classes'][m['own']]
    rows = list(enumerate(m['positives']))
    held = [trust[b] for b in m['own']]

    def mean(values):
        return sum(w * v for w, v in zip(held, values, strict=True)) / sum(held)

    terms = {
        'vote': np.dot(gaps, worth) / sum(worth),
        'objectness': 0.5 * np.dot(each, m['weights']) / m['weights'].sum(),
        'center': mean(own) + np.dot(trust[:2], nearest) / sum(trust[:2]),
        'heading_bin': 0.1 * mean([cross_entropy(m['bins'][p], m['code_bins'][i]) for i, p in rows]),
        'heading': mean([smooth_l1(m['turns'][p, m['code_bins'][i]] - m['code_turns'][i]) for i, p in rows]),
        'size_class': 0.1 * mean([cross_entropy(m['sizes'][p], kinds[i]) for i, p in rows]),
        'size': mean(
            [
                np.mean([smooth_l1(m['stretch'][p, kinds[i], a] - m['code_stretch'][i, a]) for a in range(3)])
                for i, p in rows
            ]
        ),
        'class': 0.1 * np.mean([cross_entropy(m['classes'][p], kinds[i]) for i, p in rows]),
    }
    return {f'loss_{name}': 10 * value for name, value in terms.items()}


def tensors(m):
    t = {
        name: torch.tensor(value, dtype=torch.float32 if value.dtype == float else torch.int64)
        for name, value in m.items()
    }
    prediction = BoxPrediction(
        *(t[name] for name in ('objectness', 'centers', 'bins', 'turns', 'sizes', 'stretch', 'classes'))
    )
    said = VoteOutput(t['offsets'], t['centers'], torch.tensor([0, 4, 6]), torch.zeros(6, 0).long(), prediction,
                      torch.ones(CLASSES, 3))  # fmt: skip
    code = BoxCode(
        t['boxes'][t['own'], :3], t['code_bins'], t['code_turns'], t['code_stretch'], t['box_classes'][t['own']]
    )
    targets = ProposalTargets(t['is_object'], t['weights'], t['positives'], t['own'], code)
    labels = BatchLabels(
        t['boxes'], t['box_classes'], torch.ones(3) > 0, torch.tensor([0, 2, 3]), torch.full((12,), -1), t['instance'],
        targets,
    )  # fmt: skip
    logits = torch.zeros(12, CLASSES + 1)
    return Batch(t['xyz'], torch.tensor([0, 6, 12])), DetectorOutput(logits, logits, said), labels


@pytest.mark.parametrize('seed', range(3))
def test_every_term_is_that_of_a_loop(seed):
    m = made(seed)
    got = VoteNetLoss()(*tensors(m))
    assert {name: value.item() for name, value in got.items()} == pytest.approx(slow(m), rel=1e-4)


def test_the_weight_is_of_all_terms_and_the_balance_of_votes():
    given = tensors(made())
    plain, other = VoteNetLoss()(*given), VoteNetLoss(loss_weight=5.0, vote_balance=0.0)(*given)
    for name in plain:
        if name != 'loss_vote':
            assert other[name].item() == pytest.approx(plain[name].item() / 2)
    m = made()
    gaps = [np.abs(m['offsets'][p] - (m['boxes'][i, :3] - m['xyz'][p])).sum() for p, i in enumerate(m['instance'][:6])]
    assert other['loss_vote'].item() == pytest.approx(5 * np.mean(gaps), rel=1e-5)


def with_pseudo_box(given, row):
    batch, outputs, labels = given
    annotated = labels.box_is_annotated.clone()
    annotated[row] = False
    return batch, outputs, labels._replace(box_is_annotated=annotated)


@pytest.mark.parametrize('weight', [0.0, 0.25])
def test_pseudo_boxes_teach_geometry_as_far_as_they_are_trusted(weight):
    m = made(3)
    got = VoteNetLoss(pseudo_geometry=weight)(*with_pseudo_box(tensors(m), 0))
    want = slow(m, (weight, 1.0, 1.0))
    assert {name: value.item() for name, value in got.items()} == pytest.approx(want, rel=1e-4)
    alike = VoteNetLoss()(*tensors(m))
    for name in ('loss_objectness', 'loss_class', 'loss_vote'):
        assert got[name] == alike[name], 'what is an object, and which, pseudo boxes go on teaching'


def test_without_an_annotated_box_geometry_is_not_taught_at_all():
    batch, outputs, labels = tensors(made())
    outputs.votes.prediction.centers.requires_grad_()
    labels = labels._replace(box_is_annotated=torch.zeros(3) > 0)
    got = VoteNetLoss(pseudo_geometry=0.0)(batch, outputs, labels)
    assert got['loss_center'] == 0 and got['loss_size'] == 0 and got['loss_heading'] == 0
    got['loss_center'].backward()
    assert (outputs.votes.prediction.centers.grad == 0).all()


def test_a_negative_trust_is_refused():
    with pytest.raises(ValueError, match=r'pseudo_geometry: expected 0 or more, got -1'):
        VoteNetLoss(pseudo_geometry=-1)
