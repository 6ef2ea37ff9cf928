"""Thinned scenes are scored on every original point."""

import numpy as np
import pytest

from rm3d_plugin.datasets.files import FilesDataset
from rm3d_plugin.datasets.transforms.pack import PackScene
from rm3d_plugin.datasets.transforms.points import select_points
from rm3d_plugin.evaluation.sem_seg_metric import SemSegMetric
from rm3d_plugin.storage.ply import write_ply

# three voxels of 1 m with 1, 4 and 2 points; one point of the second is of another class
XYZ = np.array([[0.5, 0, 0], [1.1, 0, 0], [1.2, 0, 0], [1.3, 0, 0], [1.4, 0, 0], [2.5, 0, 0], [2.6, 0, 0]])
LABEL = np.array([0, 1, 1, 1, 0, 1, -1])


def dataset(folder, **options):
    columns = {axis: XYZ[:, i] for i, axis in enumerate('xyz')} | {'label': LABEL.astype(np.int32)}
    write_ply(folder / 'val' / 'a.ply', columns)
    return FilesDataset(
        folder, 'val', labels='truth', classes=('x', 'y'), cache=None, pipeline=[PackScene()], **options
    )


def scores(data, predicted):
    metric = SemSegMetric()
    metric.dataset_meta = data.metainfo
    sample = data[0]['data_samples']
    sample.pred_point_probs = np.eye(2, dtype=np.float32)[predicted]
    metric.process(None, [sample])
    return metric.compute_metrics(metric.results)


def test_every_original_point_counts(tmp_path):
    data = dataset(tmp_path, voxel_downsample=1.0)
    truth = data.annotation(0)
    assert truth.semantic.tolist() == LABEL.tolist() and truth.original_index.tolist() == [0, 1, 1, 1, 1, 2, 2]
    assert truth.instance is None
    got = scores(data, [0, 1, 1])  # right on all three kept points
    assert got['IoU_x'] == pytest.approx(100 / 2) and got['IoU_y'] == pytest.approx(100 * 4 / 5)
    assert got['accuracy'] == pytest.approx(100 * 5 / 6)


def test_whole_scenes_need_no_way_back(tmp_path):
    data = dataset(tmp_path)
    assert data.annotation(0).original_index is None and data.annotation(0).semantic.tolist() == LABEL.tolist()
    assert scores(data, [0, 1, 1, 1, 0, 1, 0])['accuracy'] == 100.0


def test_points_that_are_dropped_on_the_way_are_wrong(tmp_path):
    data = dataset(tmp_path)
    data.pipeline.insert(0, lambda item: select_points(item, item['points'][:, 0] > 1))
    assert scores(data, [1, 1, 1, 0, 1, 0])['accuracy'] == pytest.approx(100 * 5 / 6)  # the first point is not there
