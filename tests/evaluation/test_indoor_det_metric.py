"""AP25, AP50 and recall as VoteNet and mmdetection3d count them."""

import numpy as np
import pytest
import torch
from mmengine.evaluator import Evaluator
from reference.indoor_ap_slow import indoor_ap_slow

from rm3d_plugin.registry import METRICS
from rm3d_plugin.structures import SceneError, SceneSample

NAMES = ('chair', 'table', 'sofa')


def random_scene(rng, turned):
    count = int(rng.integers(0, 6))
    truth = np.c_[rng.uniform(0, 4, (count, 3)), rng.uniform(0.5, 2, (count, 3)), rng.uniform(-3, 3, count) * turned]
    labels = rng.integers(0, 2, count)  # no sofa is true
    guesses = np.concatenate([truth, truth[:2]]) + rng.normal(0, 0.08, (count + len(truth[:2]), 7)) * (
        [1] * 6 + [turned]
    )
    guesses[:, 3:6] = np.abs(guesses[:, 3:6]) + 0.01
    kinds = np.r_[labels, rng.integers(0, 3, len(truth[:2]))]
    return truth, labels, guesses, kinds, rng.random(len(guesses))


def sample(truth, labels, guesses, kinds, scores):
    out = SceneSample(metainfo={'scene_id': 'room'})
    out.gt_bboxes_3d, out.gt_labels_3d = torch.as_tensor(truth), torch.as_tensor(labels)
    out.pred_bboxes_3d, out.pred_labels_3d = torch.as_tensor(guesses), torch.as_tensor(kinds)
    out.pred_scores_3d = torch.as_tensor(scores)
    return out


def evaluate(samples, **options):
    evaluator = Evaluator([METRICS.build({'type': 'IndoorDetMetric', **options})])
    evaluator.dataset_meta = {'classes': NAMES}
    evaluator.process(samples, None)
    return evaluator.evaluate(len(samples))


@pytest.mark.parametrize('turned', [0, 1])
def test_as_the_slow_twin(turned):
    rng = np.random.default_rng(turned)
    scenes = [random_scene(rng, turned) for _ in range(8)]
    got = evaluate([sample(*scene) for scene in scenes])
    means = {25: [], 50: []}
    for c, name in enumerate(NAMES[:2]):
        truths = [truth[labels == c] for truth, labels, *_ in scenes]
        found = [(guesses[kinds == c], scores[kinds == c]) for _, _, guesses, kinds, scores in scenes]
        for at, values in means.items():
            ap, recall = indoor_ap_slow(truths, found, at / 100)
            assert got[f'{name}_AP{at}'] == pytest.approx(100 * ap) and 0 < ap < 1
            assert got[f'{name}_recall{at}'] == pytest.approx(100 * recall)
            values.append((ap, recall))
    for at, values in means.items():  # sofas that were found but never true do not count
        assert (got[f'mAP{at}'], got[f'mAR{at}']) == pytest.approx(tuple(100 * np.mean(values, axis=0)))
    assert not any(key.startswith('sofa') for key in got)


def test_perfect_boxes_empty_predictions_and_other_overlaps():
    box = np.array([[0.0, 0, 0, 1, 1, 1, 0]])
    half = box + [1 / 3, 0, 0, 0, 0, 0, 0]  # overlap exactly one half: mmdetection3d and VoteNet ask for more
    assert evaluate([sample(box, [0], box, [0], [0.9])])['mAP50'] == 100
    assert evaluate([sample(box, [0], half, [0], [0.9])], iou_thresholds=[0.5001, 0.49]) == {
        'chair_AP50': 0, 'chair_recall50': 0, 'mAP50': 0, 'mAR50': 0,
        'chair_AP49': 100, 'chair_recall49': 100, 'mAP49': 100, 'mAR49': 100,
    }  # fmt: skip
    nothing = sample(box, [0], np.zeros((0, 7)), np.zeros(0, dtype=int), np.zeros(0))
    assert evaluate([nothing])['chair_recall25'] == 0


def test_errors_name_scene_and_field():
    broken = sample(np.array([[0.0, 0, 0, 1, 1, 1, 0]]), [0], np.array([[0.0, 0, 0, 1, -1, 1, 0]]), [0], [0.9])
    with pytest.raises(SceneError, match='scene room: pred_bboxes_3d cannot be used: .*sizes must be positive'):
        evaluate([broken])
    del broken.gt_bboxes_3d
    with pytest.raises(SceneError, match='IndoorDetMetric: scene room: the sample has no gt_bboxes_3d'):
        evaluate([broken])
