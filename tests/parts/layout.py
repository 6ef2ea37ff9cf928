"""Samples and boxes laid out as mmdetection3d 1.4 has them: its own classes where it is installed, else stand-ins.

The stand-ins have the fields, properties and conventions of ``mmdet3d.structures`` that are read here: boxes about the
middle of their bottom face, ``PointData`` and ``InstanceData`` inside a sample, ``eval_ann_info`` as a dict.
"""

import importlib.machinery
import importlib.util
import sys
import types
import warnings
from typing import NamedTuple

import torch
from mmengine.structures import BaseDataElement, InstanceData

HAS_MMDET3D = importlib.util.find_spec('mmdet3d') is not None


class Layout(NamedTuple):
    """Classes of mmdetection3d."""

    Det3DDataSample: type
    PointData: type
    LiDARInstance3DBoxes: type
    DepthInstance3DBoxes: type
    CameraInstance3DBoxes: type


class PointData(BaseDataElement):
    """Of points."""


class _Boxes:
    YAW_AXIS = 2

    def __init__(self, tensor, box_dim=7, with_yaw=True, origin=(0.5, 0.5, 0)):
        self.tensor = torch.as_tensor(tensor, dtype=torch.float32).reshape(-1, box_dim).clone()
        self.tensor[:, :3] += self.tensor[:, 3:6] * (torch.tensor([0.5, 0.5, 0.0]) - torch.tensor(origin))

    def __len__(self):
        return len(self.tensor)

    def __getitem__(self, index):
        return self.tensor[index]

    @property
    def gravity_center(self):
        return self.tensor[:, :3] + self.tensor[:, 3:6] * torch.tensor([0.0, 0.0, 0.5])


class LiDARInstance3DBoxes(_Boxes):
    """x to the front, y to the left, z up."""


class DepthInstance3DBoxes(_Boxes):
    """x to the right, y to the front, z up."""


class CameraInstance3DBoxes(_Boxes):
    """x to the right, y down, z to the front."""

    YAW_AXIS = 1


class Det3DDataSample(BaseDataElement):
    """A scene."""


STAND_INS = Layout(Det3DDataSample, PointData, LiDARInstance3DBoxes, DepthInstance3DBoxes, CameraInstance3DBoxes)


def mmdet3d_layout() -> Layout:
    """mmdetection3d's own classes."""
    without_extensions()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # theirs
        from mmdet3d import structures

    return Layout(*(getattr(structures, name) for name in Layout._fields))


def without_extensions() -> None:
    """Let mmdetection3d be imported beside mmcv-lite, which has no compiled operations."""
    if 'mmcv._ext' not in sys.modules and importlib.util.find_spec('mmcv._ext') is None:
        sys.modules['mmcv._ext'] = _Extensions('mmcv._ext')
        sys.modules['mmcv._ext'].__spec__ = importlib.machinery.ModuleSpec('mmcv._ext', None)


class _Extensions(types.ModuleType):
    def __getattr__(self, name):
        if name.startswith('__'):
            raise AttributeError(name)
        return lambda *args, **kwargs: None


def packed(layout: Layout, scene, boxes=None, labels=None, **masks):
    """A sample as ``Pack3DDetInputs`` makes it."""
    sample = layout.Det3DDataSample(metainfo={'sample_idx': scene, 'box_type_3d': layout.DepthInstance3DBoxes})
    sample.gt_instances_3d, sample.gt_pts_seg = InstanceData(), layout.PointData()
    if boxes is not None:
        sample.gt_instances_3d = InstanceData(bboxes_3d=boxes, labels_3d=labels)
    for name, values in masks.items():
        sample.gt_pts_seg.set_data({name: values})
    sample.eval_ann_info = None
    return sample
