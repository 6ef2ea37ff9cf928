import pytest
import torch

from rm3d_plugin.models.heads import SemanticHead, join_point_labels
from rm3d_plugin.models.heads.semantic_head import frequency_weights
from rm3d_plugin.structures import SceneError, SceneSample


def sample(semantic=None, instance=None, is_annotated=None):
    out = SceneSample(metainfo={'scene_id': 's'})
    for name, value in (
        ('pts_semantic_mask', semantic),
        ('pts_instance_mask', instance),
        ('pts_is_annotated', is_annotated),
    ):
        if value is not None:
            out.set_data({name: torch.tensor(value)})
    return out


def labels_of(semantic, is_annotated=None, classes=3):
    return join_point_labels([sample(semantic, None, is_annotated)], torch.tensor([0, len(semantic)]), classes)


def test_join_point_labels_numbers_instances_through_the_batch():
    samples = [sample([0, 1, 1, -1], [-1, 7, 3, 3], [True, False, True, True]), sample(), sample([2], [3])]
    got = join_point_labels(samples, torch.tensor([0, 4, 6, 7]), 3)
    assert got.semantic.tolist() == [0, 1, 1, -1, -1, -1, 2]
    assert got.instance.tolist() == [-1, 1, 0, 0, -1, -1, 2]
    assert got.instance_scene.tolist() == [0, 0, 2]
    assert got.is_annotated.tolist() == [True, False, True, False, False, False, True]


def test_join_point_labels_tells_what_does_not_fit():
    with pytest.raises(SceneError, match='s: pts_semantic_mask: expected 3 values, one a point'):
        join_point_labels([sample([0, 1])], torch.tensor([0, 3]), 3)
    with pytest.raises(SceneError, match='expected -1..1, got class 2'):
        join_point_labels([sample([0, 2])], torch.tensor([0, 2]), 2)
    assert join_point_labels([sample([])], torch.tensor([0, 0]), 2).semantic.tolist() == []


def test_frequency_weights_by_hand():
    # 1 / sqrt(1), 1 / sqrt(4); mean over the five labels (1 * 1 + 4 * .5) / 5 = .6
    assert frequency_weights(torch.tensor([1.0, 4.0, 0.0]), 0.5).tolist() == pytest.approx([1 / 0.6, 0.5 / 0.6, 1.0])
    assert frequency_weights(torch.tensor([3.0, 9.0]), 0.0).tolist() == [1.0, 1.0]
    assert frequency_weights(torch.zeros(2), 0.5).tolist() == [1.0, 1.0]


def test_losses_by_hand():
    logits = torch.log(torch.tensor([[0.5, 0.25, 0.25], [0.25, 0.5, 0.25], [0.2, 0.2, 0.6]]))
    labels = labels_of([0, 2, -1])
    log2, log4 = 0.6931472, 1.3862944
    assert SemanticHead(4, 3).loss(logits, labels)['loss_wsl'].item() == pytest.approx((log2 + log4) / 2)
    doubled = SemanticHead(4, 3, loss={'loss_weight': 2.0}).loss(logits, labels)
    assert doubled['loss_wsl'].item() == pytest.approx(log2 + log4)
    counted = SemanticHead(4, 3, balance='frequency', class_counts=[16, 4, 1])  # 1/4, 1/2, 1: the scale cancels
    assert counted.loss(logits, labels)['loss_wsl'].item() == pytest.approx((log2 / 4 + log4) / (1 / 4 + 1))
    batch = SemanticHead(4, 3, balance='batch', power=1.0)
    three = torch.cat([logits[:1], logits[:1], logits[1:2]])
    assert batch.loss(three, labels_of([0, 0, 2]))['loss_wsl'].item() == pytest.approx((log2 + log4) / 2)


def test_pseudo_labels_may_count_less():
    logits = torch.log(torch.tensor([[0.5, 0.5], [0.25, 0.75]]))
    labels = labels_of([0, 0], [True, False], 2)
    got = SemanticHead(4, 2, pseudo_weight=0.5).loss(logits, labels)['loss_wsl'].item()
    assert got == pytest.approx((0.6931472 + 0.5 * 1.3862944) / 1.5)


def test_annotated_labels_have_their_share_however_few_they_are():
    logits = torch.log(torch.tensor([[0.5, 0.5], [0.25, 0.75], [0.25, 0.75], [0.125, 0.875], [0.9, 0.1]]))
    log2 = 0.6931472
    head = SemanticHead(4, 2, annotated_share=0.6)
    mixed = head.loss(logits, labels_of([0, 0, 0, 0, -1], [True, False, False, False, False], 2))['loss_wsl'].item()
    assert mixed == pytest.approx(0.6 * log2 + 0.4 * (2 + 2 + 3) / 3 * log2)
    true = head.loss(logits, labels_of([0, 0, -1, -1, -1], [True] * 5, 2))['loss_wsl'].item()
    assert true == pytest.approx(1.5 * log2)
    pseudo = head.loss(logits, labels_of([-1, 0, -1, 0, -1], [False] * 5, 2))['loss_wsl'].item()
    assert pseudo == pytest.approx(2.5 * log2)
    balanced = SemanticHead(4, 2, annotated_share=0.5, balance='batch', power=1.0)
    labels = labels_of([0, 0, 0, 1, -1], [True, False, False, False, False], 2)  # classes count alike within each part
    wanted = 0.5 * log2 + 0.5 * (2 * log2 - torch.log(torch.tensor(0.875)).item()) / 2
    assert balanced.loss(logits, labels)['loss_wsl'].item() == pytest.approx(wanted)


@pytest.mark.parametrize('share', [None, 0.5])
@pytest.mark.parametrize('balance', ['none', 'frequency', 'batch'])
def test_no_labelled_point_is_a_zero_loss_with_gradients(balance, share):
    head = SemanticHead(4, 3, balance=balance, annotated_share=share)
    loss = head.loss(head(torch.ones(5, 4)), labels_of([-1] * 5))['loss_wsl']
    loss.backward()
    assert loss.item() == 0.0
    assert head.linear.weight.grad.abs().sum() == 0 and head.linear.bias.grad is not None


def test_an_unlabelled_point_has_no_gradient():
    logits = torch.randn(4, 3, requires_grad=True, generator=torch.Generator().manual_seed(0))
    SemanticHead(4, 3).loss(logits, labels_of([0, -1, 2, -1]))['loss_wsl'].backward()
    assert logits.grad[[1, 3]].abs().sum() == 0 and (logits.grad[[0, 2]].abs().sum(1) > 0).all()


def test_class_counts_are_kept_in_the_state():
    head = SemanticHead(4, 3, balance='frequency')
    head.set_class_counts(torch.tensor([1.0, 2, 3]))
    other = SemanticHead(4, 3, balance='frequency')
    other.load_state_dict(head.state_dict())
    assert other.class_counts.tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match='expected 3 class counts'):
        head.set_class_counts(torch.ones(4))


def test_bad_choices_are_told():
    with pytest.raises(ValueError, match='pseudo_weight'):
        SemanticHead(4, 3, pseudo_weight=-1.0)
    with pytest.raises(ValueError, match='annotated_share: expected a share'):
        SemanticHead(4, 3, annotated_share=1.0)
