"""Panoptic quality: the program's own example, a slow twin, and the metric through mmengine."""

import numpy as np
import pytest
import torch
from evaluation.test_seg_metrics import INSTANCE, SEMANTIC, found, one_hot, run, sample
from reference.panoptic_slow import slow_panoptic

from rm3d_plugin.evaluation.functional import PanopticCounts, panoptic_counts, panoptic_scores
from rm3d_plugin.structures import SceneError

GRASS, SKY, PERSON, DOG = range(4)


def example():
    """The picture of Kirillov et al. that the program of SemanticKITTI checks itself with: (classes, numbers) twice."""
    semantic = np.repeat([-1, GRASS, SKY, SKY, GRASS, PERSON, PERSON], [50, 40, 10, 40, 10, 50, 300])
    instance = np.repeat([-1, -1, 35, 8, 95], [50, 100, 50, 200, 100])
    true_semantic = np.repeat([-1, GRASS, SKY, DOG, PERSON], [50, 50, 50, 50, 300])
    true_instance = np.repeat([-1, 22, 33, 42, 11], [150, 50, 150, 50, 100])
    return semantic, instance, true_semantic, true_instance


def test_the_programs_own_example():
    got = panoptic_scores(panoptic_counts(*example(), num_classes=4, min_points=1), (PERSON, DOG))
    np.testing.assert_allclose(got.quality, [2 / 3, 2 / 3, 7 / 12, 0])
    np.testing.assert_allclose(got.segmentation, [2 / 3, 2 / 3, 7 / 8, 0])
    np.testing.assert_allclose(got.recognition, [1, 1, 2 / 3, 0])
    np.testing.assert_allclose(got.iou, [2 / 3, 2 / 3, 6 / 7, 0])
    means = [got.mean(values) for values in (got.quality, got.segmentation, got.recognition, got.iou)]
    np.testing.assert_allclose(means, [0.47916666666666663, 0.5520833333333333, 2 / 3, 0.5476190476190476])
    assert got.mean(got.quality, 'things') == pytest.approx(7 / 24)
    assert got.mean(got.quality, 'stuff') == pytest.approx(2 / 3)
    assert got.dagger == pytest.approx((7 / 12 + 0 + 2 / 3 + 2 / 3) / 4)


def scenes(seed, count=3, points=240, num_classes=5):
    """Found and true segments that overlap by halves, thirds and nearly whole; some points of no or unknown class."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        true = np.repeat(rng.integers(-1, num_classes, 24), points // 24)
        number = np.repeat(rng.integers(-1, 3, 24), points // 24)
        near = np.clip(np.arange(points) + rng.integers(-4, 5, points), 0, points - 1)
        semantic, instance = true[near], np.where(rng.uniform(size=points) < 0.9, number[near], 7)
        true = np.where(true < 0, rng.choice([-1, 255], points), true)
        yield np.where(semantic < 0, rng.choice([-1, num_classes, 99], points), semantic), instance, true, number


@pytest.mark.parametrize('min_points', [1, 8, 50])
@pytest.mark.parametrize('seed', range(4))
def test_equals_the_slow_twin(seed, min_points):
    given = list(scenes(seed))
    counts = sum((panoptic_counts(*scene, 5, min_points) for scene in given), PanopticCounts.none(5))
    got = panoptic_scores(counts, (0, 1))
    want = np.array(slow_panoptic(given, 5, min_points))
    assert counts.hits.sum() and (min_points > 8 or counts.missed.sum() and counts.wrong.sum())
    np.testing.assert_allclose(
        np.stack([got.quality, got.segmentation, got.recognition, got.iou], axis=1), want, atol=1e-12
    )


def test_half_is_not_enough_and_small_segments_do_not_cost():
    true = np.zeros(12, dtype=np.int64)
    numbers = np.repeat([0, 1], 6)
    half = np.where(np.arange(12) < 3, 5, numbers)  # 3 of the 6 points of one segment
    counts = panoptic_counts(true, half, true, numbers, 1, min_points=1)
    assert (counts.hits[0], counts.missed[0], counts.wrong[0]) == (1, 1, 2)
    counts = panoptic_counts(true, half, true, numbers, 1, min_points=4)
    assert (counts.hits[0], counts.missed[0], counts.wrong[0]) == (1, 1, 0)


def test_types_and_empty_scenes():
    semantic, instance, true_semantic, true_instance = example()
    want = panoptic_counts(*example(), 4, 1)
    unsigned = np.where(true_semantic < 0, 255, true_semantic).astype(np.uint8), (true_instance + 2).astype(np.uint64)
    got = panoptic_counts(semantic.astype(np.int8), instance.astype(np.int16), *unsigned, 4, 1)
    assert got.hits.tolist() == want.hits.tolist() and got.overlap.tolist() == want.overlap.tolist()
    none = panoptic_counts(*[np.zeros(0, dtype=np.int64)] * 4, 4)
    assert none.confusion.sum() == 0 and panoptic_scores(none, ()).dagger == 0.0
    skipped = panoptic_scores(panoptic_counts(*example(), 5, 1), (PERSON, DOG), absent='skip')
    assert np.isnan(skipped.quality[4]) and skipped.mean(skipped.quality) == pytest.approx(0.47916666666666663)


def test_wrong_input_is_named():
    one = np.zeros(3, dtype=np.int64)
    with pytest.raises(ValueError, match='one row a point, got 3, 3, 2, 3 rows'):
        panoptic_counts(one, one, one[:2], one, 1)
    with pytest.raises(ValueError, match='truth holds 4'):
        panoptic_counts(one, one, one + 4, one, 1)
    with pytest.raises(ValueError, match="absent: expected one of .*, got 'none'"):
        panoptic_scores(PanopticCounts.none(1), (), 'none')


def test_perfect_is_100_through_mmengine():
    got = run('PanopticQuality', [sample(pred_point_probs=one_hot(SEMANTIC), **found())], min_points=1)
    assert (got['PQ'], got['SQ'], got['RQ'], got['mIoU'], got['PQ_dagger']) == (100.0,) * 5
    assert (got['PQ_things'], got['RQ_stuff'], got['SQ_chair'], got['IoU_wall']) == (100.0,) * 4
    numbers = {'pred_pts_semantic_mask': SEMANTIC, 'pred_pts_instance_mask': INSTANCE}
    assert run('PanopticQuality', [sample(**numbers)], min_points=1) == got


def test_the_surest_mask_names_a_point_and_dropped_points_are_missed():
    masks = np.stack([INSTANCE == 0, INSTANCE == 1, INSTANCE == 2, (SEMANTIC == 1)])
    fields = {
        'pred_instance_masks': masks,
        'pred_instance_labels': np.array([1, 1, 2, 1]),
        'pred_instance_scores': np.array([0.9, 0.8, 0.7, 0.1]),
    }
    probs = one_hot(SEMANTIC)
    assert run('PanopticQuality', [sample(pred_point_probs=probs, **fields)], min_points=1)['PQ'] == 100.0
    sure = fields | {'pred_instance_scores': np.array([0.2, 0.3, 0.7, 0.9])}  # both chairs are one now
    got = run('PanopticQuality', [sample(pred_point_probs=probs, **sure)], min_points=1)
    assert got['PQ_chair'] == 0.0 and got['IoU_chair'] == 100.0 and got['PQ_dagger'] == pytest.approx(200 / 3)


def test_bfloat16_and_missing_fields():
    half = {'pred_point_probs': one_hot(SEMANTIC).to(torch.bfloat16)} | found()
    half['pred_instance_scores'] = torch.tensor(half['pred_instance_scores'], dtype=torch.bfloat16)
    assert run('PanopticQuality', [sample(**half)], min_points=1)['PQ'] == 100.0
    assert run('SemSegMetric', [sample(**half)])['mIoU'] == 100.0
    assert run('InstanceSegMetric', [sample(**half)], min_points=1)['AP50'] == 100.0
    with pytest.raises(SceneError, match='has no pred_instance_masks'):
        run('PanopticQuality', [sample(pred_point_probs=one_hot(SEMANTIC))])
