# RM3D, boxes of ScanNet, from two labelled boxes per ten rooms.
# Run: rm3d train rm3d_votenet_scannet_1pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/scannet_boxes.py'
budget = '1pct_alike'  # classes take turns; '1pct': as they come
