# RM3D, boxes of Waymo, from 3 % of the boxes.
# Run: rm3d train rm3d_votenet_waymo_3pct [--demo]
# Time: not measured.
# Score on Waymo: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/waymo.py'
budget = '3pct'
