# RM3D semantic segmentation of Oakland from 1 % of the points.
# Run: python tools/train.py configs/rm3d_sem_oakland_1pct.py --cfg-options data_root=FOLDER
# Score on Oakland's test tiles: docs/RESULTS.md. There is no demo in this format.
_base_ = [
    './_base_/runtime.py',
    './_base_/datasets/oakland.py',
    './_base_/models/segmentor_outdoor.py',
    './_base_/regions/outdoor.py',
    './_base_/budgets/points_1pct.py',
    './_base_/schedules/tiles.py',
]
ground_cell = 4.0
crop_points = 20000
voxel_size = 0.2
widths = [16, 32, 48, 64, 80]
blocks = 1
checkpoint_interval = '${sigma}'
