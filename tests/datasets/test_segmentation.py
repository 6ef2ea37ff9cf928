"""What data sets with a class for each point hand to metrics."""

import numpy as np
import pytest
from reference.toy_scenes import ToyRooms

from rm3d_plugin.evaluation import InstanceSegMetric, SemSegMetric
from rm3d_plugin.evaluation.point_fields import point_truth


def first_item(**settings):
    return ToyRooms(1, split='val', labels='truth', pipeline=settings.pop('pipeline', ()), **settings)[0]


def test_metainfo_names_the_classes_with_instances():
    dataset = ToyRooms(1)
    assert dataset.metainfo == {
        'classes': ('floor', 'box', 'wall'),
        'dataset_type': 'ToyRooms',
        'thing_classes': (1,),
    }
    metric = InstanceSegMetric()
    metric.dataset_meta = dataset.metainfo
    assert metric.evaluated == (1,)


def test_points_that_the_pipeline_dropped_count_as_wrong():
    item = first_item(pipeline=[dict(type='LimitPoints', max_points=600), dict(type='PackScene')])
    sample = item['data_samples']
    truth = sample.pts_semantic_mask
    sample.pred_point_probs = np.eye(3, dtype=np.float32)[truth.clamp_min(0).numpy()]
    whole = ToyRooms(1, split='val').load_truth(0)
    seen = point_truth(sample.to_dict(), 600, 'test')
    np.testing.assert_array_equal(seen.semantic, whole.semantic)
    np.testing.assert_array_equal(seen.instance, whole.instance)
    np.testing.assert_array_equal(seen.index, sample.point_index)
    metric = SemSegMetric(classes=('floor', 'box', 'wall'))
    metric.process(None, [sample])
    right = int((truth >= 0).sum())
    share = right / (whole.semantic >= 0).sum()
    assert metric.compute_metrics(metric.results)['accuracy'] == pytest.approx(100 * share)


def test_points_that_were_thinned_away_have_the_class_of_their_voxel():
    item = first_item(voxel_downsample=0.1, pipeline=[dict(type='PackScene')])
    sample, whole = item['data_samples'], ToyRooms(1, split='val').load_truth(0)
    rows = len(sample.point_index)
    assert rows < len(whole.semantic)
    seen = point_truth(sample.to_dict(), rows, 'test')
    np.testing.assert_array_equal(seen.semantic, whole.semantic)
    given = seen.scatter(sample.pts_semantic_mask.numpy(), -1)
    kept = ToyRooms(1, split='val', voxel_downsample=0.1)
    np.testing.assert_array_equal(given, kept.load_truth(0).semantic[kept.original_index(0)])


def test_a_scene_without_labels_has_no_annotation():
    assert ToyRooms(1, split='val', truth=False).annotation(0) is None
