# RM3D semantic segmentation of ScanNet from 0.2 % of the points.
# Run: python tools/train.py configs/rm3d_sem_scannet_0p2pct.py [--demo]
# Score on ScanNet: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = [
    './_base_/runtime.py',
    './_base_/datasets/scannet.py',
    './_base_/models/segmentor_paper.py',
    './_base_/regions/indoor.py',
    './_base_/budgets/points_0p2pct.py',
    './_base_/schedules/segmentation.py',
    './_base_/schedules/demo_rooms.py',
]
demo = dict(demo_data=dict(scenes='scannet_rooms', num_train=24, num_val=8, seed=0))
