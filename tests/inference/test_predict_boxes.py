"""Whatever the scan: range, unit, far coordinates and strengths around a network that is asked in between."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from mmengine.config import Config

from rm3d_plugin.inference.predict_boxes import BoxOptions, Detector, predict_boxes
from rm3d_plugin.inference.trained import TrainedNetwork
from rm3d_plugin.storage.ply import write_ply
from rm3d_plugin.structures import PointCloud, SceneError


class OneBox:
    """Says one box around the middle of the points that it is given, and keeps what it was given."""

    def test_step(self, batch):
        (points,) = batch['inputs']['points']
        self.points = points.numpy()
        middle = self.points[:, :3].mean(axis=0)
        return [
            SimpleNamespace(
                pred_bboxes_3d=torch.tensor(np.r_[middle, 2.0, 1.0, 1.0, 0.5][None]),
                pred_labels_3d=torch.tensor([0]),
                pred_scores_3d=torch.tensor([0.7]),
            )
        ]


def detector(**settings):
    from rm3d_plugin.datasets.transforms import PackScene

    settings = {'point_range': None, 'intensity_range': None} | settings
    return Detector(model=OneBox(), pipeline=[PackScene()], classes=('boat',), **settings)


def scan(path, shift=(0, 0, 0), **channels):
    xyz = np.random.default_rng(0).uniform(-4, 4, (50, 3)) + shift
    return write_ply(path, {axis: xyz[:, i] for i, axis in enumerate('xyz')} | channels), xyz.mean(axis=0)


@pytest.mark.parametrize('unit', [1.0, 4.0])
@pytest.mark.parametrize('shift', [(0, 0, 0), (500_000, 5_000_000, 80)])
def test_boxes_are_in_metres_and_in_the_coordinates_of_the_file(unit, shift, tmp_path):
    path, middle = scan(tmp_path / 'a.ply', shift)
    (out,) = predict_boxes(detector(unit=unit), [path], tmp_path / 'out', 0.1, BoxOptions('openpcdet'))
    *row, name, score = out.read_text().split()
    np.testing.assert_allclose([float(v) for v in row[:3]], middle, atol=1e-3 * unit)
    np.testing.assert_allclose([float(v) for v in row[3:]], [2 * unit, unit, unit, 0.5], rtol=1e-6)
    assert (name, score) == ('boat', '0.7')
    assert not list(predict_boxes(detector(), [path], tmp_path / 'none', 0.8, BoxOptions('openpcdet')))[0].read_text()


def test_every_scan_gives_the_network_one_strength_in_0_to_1(tmp_path):
    xyz = np.zeros((40, 3))
    bright = detector(intensity_range=1.0)
    bright.detect(PointCloud(xyz, intensity=np.linspace(0, 0.5, 40)))
    np.testing.assert_allclose(bright.model.points[:, 3], np.linspace(0, 0.5, 40), rtol=1e-6)
    bright.detect(PointCloud(xyz, intensity=np.linspace(0, 60_000, 40)))  # another sensor: by its own range
    assert bright.model.points[:, 3].max() == 1 and 0.4 < bright.model.points[20, 3] < 0.6
    bright.detect(PointCloud(xyz, colors=np.full((40, 3), 0.25)))
    assert bright.model.points.shape == (40, 4) and (bright.model.points[:, 3] == 0.25).all()
    bright.detect(PointCloud(xyz))
    assert not bright.model.points[:, 3].any()
    path, _ = scan(tmp_path / 'a.ply', intensity=np.linspace(100, 200, 50).astype(np.float32))
    list(predict_boxes(bright, [path], tmp_path, 0.1, BoxOptions('json', intensity_range=(100, 200))))
    np.testing.assert_allclose(bright.model.points[:, 3], np.linspace(0, 1, 50), atol=1e-6)


def test_boxes_in_bfloat16(monkeypatch):
    asked = OneBox.test_step

    def rounded(self, batch):
        (sample,) = asked(self, batch)
        sample.pred_bboxes_3d, sample.pred_scores_3d = (
            sample.pred_bboxes_3d.bfloat16(),
            sample.pred_scores_3d.bfloat16(),
        )
        return [sample]

    monkeypatch.setattr(OneBox, 'test_step', rounded)
    boxes = detector().detect(PointCloud(np.full((4, 3), 1.5, dtype=np.float32)))
    np.testing.assert_array_equal(boxes.tensor, [[1.5, 1.5, 1.5, 2, 1, 1, 0.5]])
    np.testing.assert_allclose(boxes.scores, [0.7], atol=0.002)


def test_what_lies_outside_the_range_is_left_out(tmp_path):
    path, _ = scan(tmp_path / 'a.ply')
    near = detector(point_range=(-2, -2, -2, 2, 2, 2))
    list(predict_boxes(near, [path], tmp_path, 0.1, BoxOptions('json')))
    assert 0 < len(near.model.points) < 50 and np.abs(near.model.points[:, :3]).max() <= 2
    away = detector(point_range=(90, 90, 0, 95, 95, 1))
    with pytest.raises(SceneError, match=r'a.ply: none of its 50 points lies in the range \[90, 90, 0, 95, 95, 1\]'):
        list(predict_boxes(away, [path], tmp_path, 0.1))


def test_what_a_run_tells_of_its_scans():
    def read(**dataset):
        config = Config({'val_dataloader': {'dataset': {'classes': ['boat'], 'pipeline': [], **dataset}}})
        return Detector.from_network(TrainedNetwork(OneBox(), [], config, ('boat',)))

    own = read(type='BoxFilesDataset', point_range=None, unit=4.0, intensity_range=None)
    assert (own.point_range, own.unit, own.intensity_range, own.camera_view) == (None, 4.0, None, False)
    kitti = read(type='KittiDataset', point_range=[0, -1, -1, 1, 1, 1])
    assert (kitti.unit, kitti.intensity_range, kitti.camera_view) == (1.0, 1.0, True)
    assert kitti.point_range == (0, -1, -1, 1, 1, 1)
