# RM3D, boxes of ScanNet, from 3 % of the boxes.
# Run: rm3d train rm3d_votenet_scannet_3pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/scannet_boxes.py'
budget = '3pct'
