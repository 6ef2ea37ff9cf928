# RM3D, boxes of KITTI, from 3 % of the boxes.
# Run: rm3d train rm3d_votenet_kitti_3pct [--demo]
# Time: not measured.
# Score on KITTI: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/kitti.py'
budget = '3pct'
