# RM3D, boxes of Waymo, from two labelled boxes per ten frames.
# Run: rm3d train rm3d_votenet_waymo_1pct [--demo]
# Time: not measured.
# Score on Waymo: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/waymo.py'
budget = '1pct_alike'  # classes take turns; '1pct': as they come
