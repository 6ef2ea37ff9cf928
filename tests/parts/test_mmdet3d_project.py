"""The project of docs/parts.md as a user would type it, on three tiny rooms, where mmdetection3d is installed."""

import json
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from parts.layout import HAS_MMDET3D

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / 'docs' / 'parts.md').read_text(encoding='utf-8')
RUN = """
import sys
from parts.layout import without_extensions
without_extensions()
from mmengine.config import Config
from mmengine.runner import Runner
config = Config.fromfile('rm3d_unet_s3dis.py')
config.merge_from_dict({
    'work_dir': 'work', 'train_cfg.max_epochs': 2, 'train_cfg.val_interval': 1, 'model.backbone.preset': None,
    'model.backbone.widths': [8, 16], 'model.backbone.voxel_size': 0.2, **PREPROCESSOR,
})
Runner.from_cfg(config).train()
"""


def config_text():
    return re.search(r'```python\n(# rm3d_unet_s3dis\.py.*?)```', TEXT, re.S)[1]


def make_rooms(folder):
    """Five areas of one room each, in the layout of mmdetection3d's tools."""
    for name in ('points', 'semantic_mask', 'seg_info'):
        (folder / name).mkdir(parents=True)
    for area in range(1, 7):
        rng = np.random.default_rng(area)
        name = f'Area_{area}_office_1.bin'
        labels = rng.integers(0, 14, 2000)  # 13: no class
        xyz = np.c_[rng.random((2000, 2)) * 4, labels / 7 + rng.normal(0, 0.02, 2000)]
        np.c_[xyz, rng.random((2000, 3)) * 255].astype(np.float32).tofile(folder / 'points' / name)
        labels.astype(np.int64).tofile(folder / 'semantic_mask' / name)
        info = dict(lidar_points=dict(lidar_path=name, num_pts_feats=6), pts_semantic_mask_path=name, sample_idx=area)
        content = dict(metainfo=dict(dataset='s3dis'), data_list=[info])
        (folder / f's3dis_infos_Area_{area}.pkl').write_bytes(pickle.dumps(content))
        np.save(folder / 'seg_info' / f'Area_{area}_resampled_scene_idxs.npy', np.zeros(2, dtype=np.int32))


def test_the_config_is_one_page():
    assert len(config_text().splitlines()) <= 75
    compile(config_text(), 'rm3d_unet_s3dis.py', 'exec')


@pytest.mark.skipif(not HAS_MMDET3D, reason='mmdet3d is not installed (make mmdet3d)')
@pytest.mark.parametrize(
    'preprocessor', ['{}', "{'model.data_preprocessor': dict(type='Det3DDataPreprocessor')}"], ids=['ours', 'theirs']
)
def test_mmdetection3d_trains_our_network_and_both_metrics_agree(tmp_path, preprocessor):
    make_rooms(tmp_path / 'data' / 's3dis')
    (tmp_path / 'rm3d_unet_s3dis.py').write_text(config_text())
    (tmp_path / 'run.py').write_text(RUN.replace('PREPROCESSOR', preprocessor))
    done = subprocess.run(
        [sys.executable, '-W', 'ignore', 'run.py'],
        cwd=tmp_path,
        env={
            'PYTHONPATH': f'{ROOT}:{ROOT / "tests"}',
            'PATH': '/usr/bin:/bin',
            'OMP_NUM_THREADS': '1',
            'HOME': str(tmp_path),
        },
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    (log,) = (tmp_path / 'work').glob('*/vis_data/scalars.json')
    rows = [json.loads(line) for line in log.read_text().splitlines()]
    losses = [row['loss_wsl'] for row in rows if 'loss_wsl' in row]
    assert losses and all(loss > 0.5 for loss in losses)  # 13 classes: about 2.6 at first
    scores = [row for row in rows if 'miou' in row]
    assert len(scores) == 2
    for row in scores:
        assert row['rm3d/mIoU'] == pytest.approx(100 * row['miou'], abs=0.01) and row['miou'] > 0
        assert row['rm3d/accuracy'] == pytest.approx(100 * row['acc'], abs=0.01)
