# The same network and schedule on all boxes: full supervision; the first labels stay.
# Run: python tools/train.py configs/sup_votenet_kitti_full.py [--demo]
# Score on KITTI: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = [
    './_base_/runtime.py',
    './_base_/datasets/kitti.py',
    './_base_/models/votenet_kitti.py',
    './_base_/regions/lidar.py',
    './_base_/budgets/boxes_full.py',
    './_base_/schedules/detection.py',
]
label_refreshes = 1
