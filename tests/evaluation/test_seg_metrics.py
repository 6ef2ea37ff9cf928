"""The registered metrics of segmentation, through mmengine's evaluator."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from mmengine.evaluator import Evaluator

from rm3d_plugin.datasets.base import Truth
from rm3d_plugin.registry import METRICS
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import Boxes3D, PseudoLabels, SceneError, SceneSample

CLASSES = ('wall', 'chair', 'table')
SEMANTIC = np.repeat([1, 1, 2, 0, -1], [10, 10, 10, 5, 5])
INSTANCE = np.repeat([0, 1, 2, -1, -1], [10, 10, 10, 5, 5])


def run(kind, samples, batch=None, thing_classes=(1, 2), **options):
    evaluator = Evaluator([METRICS.build({'type': kind, **options})])
    evaluator.dataset_meta = {'classes': CLASSES, 'thing_classes': thing_classes}
    evaluator.process(samples, batch)
    return evaluator.evaluate(len(samples))


def sample(index=None, truth=True, annotation=None, scene='a', **fields):
    meta = {'scene_id': scene, 'num_points': len(SEMANTIC)} | ({} if annotation is None else {'annotation': annotation})
    out = SceneSample(metainfo=meta)
    rows = np.arange(len(SEMANTIC)) if index is None else np.asarray(index)
    if truth:
        out.pts_semantic_mask = torch.as_tensor(SEMANTIC[rows])
        out.pts_instance_mask = torch.as_tensor(INSTANCE[rows])
    if index is not None:
        out.point_index = torch.as_tensor(rows)
    for name, value in fields.items():
        out.set_data({name: torch.as_tensor(value)})
    return out


def one_hot(classes, columns=3):
    return torch.eye(columns)[torch.as_tensor(np.maximum(classes, 0))]


def found(rows=slice(None), masks=None):
    given = np.stack([INSTANCE == i for i in range(3)]) if masks is None else masks
    return {
        'pred_instance_masks': given[:, rows],
        'pred_instance_labels': np.array([1, 1, 2])[: len(given)],
        'pred_instance_scores': np.array([0.9, 0.8, 0.7], dtype=np.float32)[: len(given)],
    }


def test_perfect_classes_are_100_and_the_table_names_them(monkeypatch):
    said = []
    monkeypatch.setattr('rm3d_plugin.evaluation.sem_seg_metric.print_log', lambda text, logger: said.append(text))
    got = run('SemSegMetric', [sample(pred_point_probs=one_hot(SEMANTIC))])
    assert (got['mIoU'], got['mAcc'], got['accuracy']) == (100.0, 100.0, 100.0)
    assert got['IoU_chair'] == 100.0
    text = ''.join(said)
    assert 'chair' in text and 'recall' in text and 'mean' in text


def test_scenes_count_together_and_a_mask_works_as_well_as_probabilities():
    wrong = np.where(SEMANTIC == 2, 1, SEMANTIC)
    samples = [sample(pred_point_probs=one_hot(SEMANTIC)), sample(pred_pts_semantic_mask=wrong)]
    got = run('SemSegMetric', samples)
    assert got['IoU_chair'] == pytest.approx(100 * 40 / 50)
    assert got['IoU_table'] == pytest.approx(50)


def test_a_background_column_and_rows_without_a_prediction_are_no_class():
    probs = torch.cat([one_hot(SEMANTIC), torch.zeros(40, 1)], dim=1)
    probs[0] = torch.tensor([0.0, 0, 0, 1])
    probs[1] = float('nan')
    probs[2] = 0
    got = run('SemSegMetric', [sample(pred_point_probs=probs)])
    assert got['IoU_chair'] == pytest.approx(100 * 17 / 20) and got['IoU_wall'] == 100


def test_dropped_points_count_as_missing_where_the_whole_truth_is_known():
    kept = np.arange(40) % 2 == 0
    whole = Truth(Boxes3D.empty(), SEMANTIC, INSTANCE)
    probs = one_hot(SEMANTIC[kept])
    rows = np.flatnonzero(kept)
    assert run('SemSegMetric', [sample(rows, pred_point_probs=probs)])['mIoU'] == 100
    assert run('SemSegMetric', [sample(rows, annotation=whole, pred_point_probs=probs)])['mAcc'] == pytest.approx(
        100 * (0.5 + 0.5 + 0.4) / 3  # walls 30..34: 30, 32, 34 are kept = .6
        + 100 * 0.2 / 3
    )
    full = run('InstanceSegMetric', [sample(rows, annotation=whole, **found(rows))], min_points=1)
    assert full['AP50'] == 0.0  # half of each instance: overlap .5 is not more than .5
    assert full['AP25'] == 100.0
    order = np.random.default_rng(0).permutation(40)
    shuffled = sample(order, truth=False, annotation=whole, pred_point_probs=one_hot(SEMANTIC[order]))
    assert run('SemSegMetric', [shuffled])['mIoU'] == 100


def test_a_thinned_scene_is_scored_on_its_original_points():
    kept = np.arange(0, 40, 5)  # each fifth point stands for five
    whole = SimpleNamespace(semantic=SEMANTIC, instance=INSTANCE, original_index=np.arange(40) // 5)
    thin = SceneSample(metainfo={'scene_id': 'a', 'annotation': whole})
    order = np.array([3, 0, 1, 2, 7, 6, 5])  # the network saw these; the fifth (of the table) was dropped
    thin.point_index = torch.as_tensor(order)
    thin.pred_point_probs = one_hot(SEMANTIC[kept][order])
    got = run('SemSegMetric', [thin])
    assert got['IoU_chair'] == 100 and got['IoU_table'] == 50
    for name, value in found(kept[order]).items():
        thin.set_data({name: torch.as_tensor(value)})
    assert run('InstanceSegMetric', [thin], min_points=10)['AP50_chair'] == 100
    whole.original_index = whole.original_index[:-1]
    thin.set_metainfo({'annotation': whole})
    with pytest.raises(SceneError, match='39 true original_index rows, but 40'):
        run('SemSegMetric', [thin])


def test_instances_perfect_empty_and_duplicate():
    got = run('InstanceSegMetric', [sample(**found())], min_points=1)
    assert (got['AP'], got['AP50'], got['AP25']) == (100.0, 100.0, 100.0)
    assert got['AP50_chair'] == 100.0 and 'AP50_wall' not in got
    nothing = found(masks=np.zeros((0, 40), dtype=bool))
    assert run('InstanceSegMetric', [sample(**nothing)], min_points=1)['AP'] == 0.0
    twice = {k: np.concatenate([v, v[:1]]) for k, v in found().items()}
    twice['pred_instance_scores'][-1] = 0.85  # before the second chair
    assert run('InstanceSegMetric', [sample(**twice)], min_points=1)['AP_chair'] < 100
    assert run('InstanceSegMetric', [sample(**found())])['AP'] == 0.0  # all under 100 points


def test_s3dis_and_its_choice_of_classes():
    got = run('S3DISInstanceMetric', [sample(**found())], instance_classes=['chair'])
    assert (got['mPrec'], got['mRec'], got['mCov'], got['mWCov'], got['AP50']) == (100.0,) * 5
    assert 'precision_table' not in got
    unsure = found()
    unsure['pred_instance_scores'][1] = 0.01
    sure = run('S3DISInstanceMetric', [sample(**unsure)], min_score=0.1)
    assert sure['recall_chair'] == 50 and sure['AP50'] == 100
    with pytest.raises(ValueError, match="'sofa' is none of"):
        run('S3DISInstanceMetric', [sample(**found())], instance_classes=['sofa'])


def test_without_thing_classes_all_are_evaluated():
    got = run('S3DISInstanceMetric', [sample(**found())], thing_classes=())
    assert got['recall_chair'] == 100.0


@pytest.mark.parametrize('kind', ['SemSegMetric', 'InstanceSegMetric', 'S3DISInstanceMetric'])
def test_missing_fields_are_named(kind):
    with pytest.raises(SceneError, match='scene a: the sample has no pred_'):
        run(kind, [sample()])
    with pytest.raises(SceneError, match='has no pts_semantic_mask'):
        run(kind, [sample(truth=False, pred_point_probs=one_hot(SEMANTIC), **found())])


def test_rows_that_do_not_fit_are_an_error():
    with pytest.raises(SceneError, match='39 predicted rows do not fit 40'):
        run('SemSegMetric', [sample(pred_point_probs=one_hot(SEMANTIC)[:39])])
    with pytest.raises(SceneError, match='39 predicted rows do not fit 40'):
        run('InstanceSegMetric', [sample(**found(slice(39)))])


def store_of(folder, semantic, instance, is_annotated):
    store = LabelStore(folder)
    store.begin_round(0)
    labels = PseudoLabels(
        semantic=semantic,
        instance=instance,
        point_is_annotated=is_annotated,
        confidence=np.zeros(len(semantic), dtype=np.float32),
        boxes=Boxes3D.empty(),
        box_is_annotated=np.zeros(0, dtype=bool),
    )
    store.write(0, 'a', labels)
    store.finish_round(0)
    store.set_current(0)


def test_pseudo_labels_by_hand(tmp_path):
    semantic, instance = SEMANTIC.copy(), INSTANCE.copy()
    semantic[:2] = 2  # wrong
    semantic[2:6] = -1
    instance[:6] = -1
    is_annotated = np.zeros(40, dtype=bool)
    is_annotated[10] = True
    store_of(tmp_path, semantic, instance, is_annotated)
    xyz = np.zeros((40, 3), dtype=np.float32)
    xyz[:, 0] = np.arange(40)
    batch = {'inputs': {'points': [torch.as_tensor(xyz)]}}
    votes = np.zeros((40, 3), dtype=np.float32)
    votes[:, 0] = np.repeat([4.5, 14.5, 24.5, 0, 0], [10, 10, 10, 5, 5]) + 0.25
    got = run('PseudoLabelMetric', [sample(pred_point_centers=votes)], batch, label_store=tmp_path)
    assert got['coverage'] == pytest.approx(100 * 31 / 40)
    assert got['coverage_chair'] == pytest.approx(100 * 15 / 19)  # the annotated one does not count
    assert got['precision_chair'] == 100 and got['precision_table'] == pytest.approx(100 * 10 / 12)
    assert got['precision'] == pytest.approx(100 * 28 / 30)
    # points 6..9 of the first chair: centre 7.5 instead of 4.5; the rest is exact
    assert got['offset_error'] == pytest.approx(4 * 3 / (4 + 9 + 10))
    assert got['vote_error'] == pytest.approx(0.25)
    half = np.arange(0, 40, 2)
    some = run(
        'PseudoLabelMetric', [sample(half)], {'inputs': {'points': [torch.as_tensor(xyz[half])]}}, label_store=tmp_path
    )
    assert some['coverage'] == pytest.approx(100 * np.mean(semantic[half] >= 0))


def test_pseudo_labels_without_coordinates_or_scenes(tmp_path):
    store_of(tmp_path, SEMANTIC, INSTANCE, np.zeros(40, dtype=bool))
    got = run('PseudoLabelMetric', [sample()], label_store=tmp_path)
    assert got['precision'] == 100 and 'offset_error' not in got
    with pytest.raises(SceneError, match='do not fit the 40 points'):
        run('PseudoLabelMetric', [sample(np.arange(39), truth=False, pts_semantic_mask=SEMANTIC)], label_store=tmp_path)


def test_against_labels_of_the_run_itself_there_is_no_score_but_agreement(monkeypatch):
    said = []
    monkeypatch.setattr('rm3d_plugin.evaluation.sem_seg_metric.print_log', lambda text, logger: said.append(text))
    wrong = np.where(SEMANTIC == 2, 1, SEMANTIC)  # 25 of 35 labelled points agree
    got = run('SemSegMetric', [sample(pred_point_probs=one_hot(wrong))], labels='store')
    assert got == {'agreement_not_accuracy': pytest.approx(100 * 25 / 35)}
    assert said == ['The network: 71.43 % agreement with its own pseudo labels, not accuracy']
    with pytest.raises(ValueError, match="labels: expected one of truth, store, got 'stored'"):
        run('SemSegMetric', [], labels='stored')


def test_without_a_true_class_there_is_no_score():
    metric = METRICS.build({'type': 'SemSegMetric', 'classes': ('a', 'b')})
    assert metric.compute_metrics([]) == {}
