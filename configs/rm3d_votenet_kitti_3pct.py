# RM3D detection on KITTI from 3 % of the boxes.
# Run: python tools/train.py configs/rm3d_votenet_kitti_3pct.py [--demo]
# Score on KITTI: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = [
    './_base_/runtime.py',
    './_base_/datasets/kitti.py',
    './_base_/models/votenet_kitti.py',
    './_base_/regions/lidar.py',
    './_base_/budgets/boxes_3pct.py',
    './_base_/schedules/detection.py',
]
