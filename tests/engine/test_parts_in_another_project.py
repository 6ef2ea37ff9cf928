"""Our losses, head and hook in somebody else's mmengine project: own model, own scenes, own source of labels."""

import json
import subprocess
import sys

import numpy as np
import pytest

CONFIG = """
custom_imports = dict(imports=['rm3d_plugin', 'blocks'], allow_failed_imports=False)
default_scope = 'mmengine'
work_dir = '{work}'
model = dict(
    type='BlockNet',
    aug_loss=dict(type='rm3d_plugin.JSAugLoss', loss_weight=0.5),
    dice_loss=dict(type='rm3d_plugin.DiceLoss'),
    head=dict(type='rm3d_plugin.SceneClassHead', num_classes=1),
)
loader = dict(batch_size=1, num_workers=0, collate_fn=dict(type='pseudo_collate'))
train_dataloader = dict(
    **loader,
    sampler=dict(type='DefaultSampler', shuffle=True),
    dataset=dict(type='Blocks', store='{work}/labels', repeat=10),
)
train_cfg = dict(by_epoch=True, max_epochs=4)
optim_wrapper = dict(type='OptimWrapper', optimizer=dict(type='Adam', lr=0.05))
randomness = dict(seed=0)
custom_hooks = [
    dict(type='LossHook'),
    dict(type='rm3d_plugin.RunRecordHook'),
    dict(type='rm3d_plugin.ReportHook', train_scenes=0, val_scenes=0),
    dict(type='rm3d_plugin.ReportHook', train_scenes=1, val_scenes=0),
    dict(
        type='rm3d_plugin.RegionMergeHook',
        interval=2,
        rounds=2,
        dataloader=dict(
            **loader, sampler=dict(type='DefaultSampler', shuffle=False), dataset=dict(type='Blocks', store=None)),
        label_maker=dict(
            type='rm3d_plugin.DetectionLabelMaker',
            store='{work}/labels',
            cache='{work}/cache',
            source=dict(type='BlockSource'),
            descriptor=dict(type='AdaptedPFH', radius=0.6, max_neighbors=24),
            oversegmenter=dict(type='RegionGrowing'),
            max_gap=0.5,
        ),
    ),
]
"""

BLOCKS = '''
"""Four scenes, each with two blocks on the ground; one block of each scene has a label."""
import json
from pathlib import Path

import numpy as np
import torch
from mmengine.hooks import Hook
from mmengine.model import BaseModel
from mmengine.registry import DATASETS, HOOKS, MODELS, TASK_UTILS
from mmengine.structures import BaseDataElement
from torch import nn
from torch.nn import functional as F

from rm3d_plugin.labeling import LabelSource
from rm3d_plugin.models.heads.batch_labels import BatchLabels
from rm3d_plugin.pseudo_labels import AnnotatedLabels
from rm3d_plugin.storage import LabelStore
from rm3d_plugin.structures import Boxes3D, PointCloud

NAMES = ['a', 'b', 'c', 'd']


def scene(index):
    """Points of scene ``index``, and for each the number of its block or -1."""
    rng = np.random.default_rng(index)
    x, y = np.meshgrid(np.arange(-4, 4, 0.2), np.arange(-4, 4, 0.2))
    parts, owner = [np.c_[x.ravel(), y.ravel(), np.zeros(x.size)]], [np.full(x.size, -1)]
    for number, (cx, cy) in enumerate([(-2.0, rng.uniform(-2, 2)), (2.0, rng.uniform(-2, 2))]):
        face = rng.uniform(-0.5, 0.5, (300, 3))
        axis = rng.integers(3, size=300)
        face[np.arange(300), axis] = np.where(rng.random(300) < 0.5, -0.5, 0.5)
        parts.append(face + [cx, cy, 0.6])
        owner.append(np.full(300, number))
    return np.concatenate(parts).astype(np.float32), np.concatenate(owner)


@TASK_UTILS.register_module()
class BlockSource(LabelSource):
    classes, scene_ids = ('block',), NAMES

    def load_cloud(self, index):
        return PointCloud(xyz=scene(index)[0])

    def annotated_labels(self, index):
        xyz, owner = scene(index)
        seen = owner == 0
        points = xyz[seen]
        middle, size = (points.min(0) + points.max(0)) / 2, points.max(0) - points.min(0) + 0.02
        box = Boxes3D(np.concatenate([middle, size, [0.0]])[None], np.zeros(1, dtype=np.int64))
        return AnnotatedLabels(np.where(seen, 0, -1), np.where(seen, 0, -1), box)


@DATASETS.register_module()
class Blocks(torch.utils.data.Dataset):
    def __init__(self, store, repeat=1):
        self.store, self.repeat = None if store is None else LabelStore(store), repeat

    def __len__(self):
        return len(NAMES) * self.repeat

    def __getitem__(self, index):
        index %= len(NAMES)
        sample = BaseDataElement(metainfo={'scene_id': NAMES[index], 'num_points': len(scene(index)[0])})
        if self.store is not None:
            labels = self.store.read(NAMES[index])
            sample.labels = torch.from_numpy(labels.semantic)
            sample.owner = torch.from_numpy(labels.instance)
            sample.boxes = torch.from_numpy(labels.boxes.tensor).float()
            sample.is_annotated = torch.from_numpy(labels.box_is_annotated)
        return {'inputs': torch.from_numpy(scene(index)[0]), 'data_samples': sample}


@MODELS.register_module()
class BlockNet(BaseModel):
    def __init__(self, aug_loss, dice_loss, head):
        super().__init__()
        self.net = nn.Sequential(nn.Linear(1, 16), nn.ReLU(), nn.Linear(16, 2))
        self.aug_loss, self.dice_loss, self.head = (MODELS.build(part) for part in (aug_loss, dice_loss, head))

    def set_label_statistics(self, statistics):
        self.annotated = statistics.class_counts.tolist()

    def forward(self, inputs, data_samples, mode='tensor'):
        (xyz,), (sample,) = inputs, data_samples
        logits = self.net(4 * xyz[:, 2:])
        if mode == 'predict':
            sample.pred_point_probs = logits.softmax(1)
            return [sample]
        known = sample.labels >= 0
        other = self.net(4 * xyz[:, 2:] + 0.08 * torch.randn(len(xyz), 1))
        boxes = len(sample.boxes)
        rows = BatchLabels(sample.boxes, torch.zeros(boxes, dtype=torch.long), sample.is_annotated,
                           torch.tensor([0, boxes]), sample.labels, sample.owner)
        member = (sample.labels[known] == 0).float()
        return {
            'loss_points': F.cross_entropy(logits[known], sample.labels[known]),
            'loss_aug': self.aug_loss(logits, other),
            'loss_dice': self.dice_loss(logits[known].softmax(1)[None, :, 0], member[None]),
            **self.head.loss(logits, rows),
        }


@HOOKS.register_module()
class LossHook(Hook):
    def before_train(self, runner):
        self.told = []

    def after_train_iter(self, runner, batch_idx, data_batch=None, outputs=None):
        self.told.append({'epoch': runner.epoch, **{name: float(value) for name, value in outputs.items()}})

    def after_train(self, runner):
        (Path(runner.work_dir) / 'losses.json').write_text(json.dumps(self.told))
'''

RUN = """
import sys
from mmengine.config import Config
from mmengine.runner import Runner
assert not any(name.startswith('rm3d_plugin') for name in sys.modules)
Runner.from_cfg(Config.fromfile(sys.argv[1])).train()
"""


@pytest.fixture(scope='module')
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp('project')
    for name, text in (('blocks.py', BLOCKS), ('run.py', RUN), ('config.py', CONFIG.format(work=folder / 'work'))):
        (folder / name).write_text(text)
    command = [sys.executable, 'run.py', 'config.py']
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    (folder / 'log.txt').write_text(done.stdout + done.stderr)
    return folder


def test_it_trains_with_every_part(project):
    losses = json.loads((project / 'work' / 'losses.json').read_text())
    assert [row['epoch'] for row in losses] == [0] * 40 + [1] * 40 + [2] * 40 + [3] * 40
    names = {'loss', 'loss_points', 'loss_aug', 'loss_dice', 'loss_scene_class'}
    assert all(set(row) == {'epoch', *names} for row in losses)
    assert all(row['loss_aug'] >= 0 and row['loss_dice'] >= 0 and row['loss_scene_class'] > 0 for row in losses)
    for name in ('loss', 'loss_points', 'loss_dice', 'loss_scene_class'):
        assert losses[-1][name] < 0.7 * losses[0][name], name


def test_the_hook_makes_two_rounds_and_the_second_finds_the_hidden_blocks(project):
    sys.path.insert(0, str(project))
    try:
        from blocks import NAMES, scene
    finally:
        sys.path.remove(str(project))
    from rm3d_plugin.storage import LabelStore

    store = LabelStore(project / 'work' / 'labels')
    assert store.rounds() == (0, 1) and list(store.scenes(1)) == NAMES
    for index, name in enumerate(NAMES):
        points, owner = scene(index)
        first, second = store.read(name, 0), store.read(name, 1)
        assert (first.semantic[owner == 0] == 0).all() and (second.semantic[owner == 0] == 0).all()
        assert (first.semantic[owner == 1] != 0).all(), 'no network, so nothing tells what the hidden block is'
        assert (second.semantic[owner == 1] == 0).mean() > 0.9
        assert (second.semantic[owner == -1] == 0).mean() < 0.02  # ground close to a block may go with it
        assert len(first.boxes) == 1 and second.box_is_annotated.sum() == 1
        found = second.boxes.tensor[~second.box_is_annotated, :3]
        block = points[owner == 1].mean(axis=0)
        assert np.linalg.norm(found - block, axis=1).min() < 0.3  # without votes a block may fall into several boxes


def test_the_report_tells_of_labels_and_losses_and_says_what_pictures_need(project):
    page = (project / 'work' / 'report.html').read_text()
    assert 'loss_dice' in page and page.count('<svg') + page.count('data:image/png') >= 1
    told = (project / 'log.txt').read_text()
    assert 'no report.html: ReportHook: the prediction of scene a has no pred_bboxes_3d' in told
