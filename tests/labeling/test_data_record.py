"""A run that goes on notices data that changed under it."""

from types import SimpleNamespace

import numpy as np
import pytest

from rm3d_plugin.labeling.data_record import check_data
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.structures import Boxes3D, PointCloud, SceneError


def source(xyz, semantic=None, boxes=None):
    none = np.full(len(xyz), -1)
    shown = AnnotatedLabels(
        none if semantic is None else semantic, none, boxes or Boxes3D.empty(), complete=semantic is not None
    )
    return SimpleNamespace(scene_ids=('room',), load_cloud=lambda _: PointCloud(xyz), annotated_labels=lambda _: shown)


def test_changed_points_boxes_and_labels_are_named(tmp_path):
    xyz, semantic = np.random.default_rng(0).random((5, 3)), np.array([0, 1, 1, 0, 2])
    boxes = Boxes3D(np.arange(14.0).reshape(2, 7) + 1, np.array([0, 1]))
    check_data(tmp_path, source(xyz, semantic, boxes), keep=True)  # of an older version: nothing to compare with
    check_data(tmp_path, source(xyz, semantic, boxes), keep=True)
    cases = {
        'points': source(xyz[::-1], semantic, boxes),
        'labels': source(xyz, semantic[::-1], boxes),
        'points and labels': source(xyz[::-1], semantic[::-1], boxes),
    }
    for what, changed in cases.items():
        with pytest.raises(SceneError, match=f'scene room: its {what} changed since the run began'):
            check_data(tmp_path, changed, keep=True)
    with pytest.raises(SceneError, match='its labels changed'):
        check_data(tmp_path, source(xyz, semantic, boxes.select(np.array([1, 0]))), keep=True)
    check_data(tmp_path, cases['points'], keep=False)
    check_data(tmp_path, cases['points'], keep=True)
