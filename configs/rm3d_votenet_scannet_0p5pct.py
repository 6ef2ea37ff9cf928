# RM3D, boxes of ScanNet, from one labelled box per ten rooms.
# Run: rm3d train rm3d_votenet_scannet_0p5pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/scannet_boxes.py'
budget = '0p5pct_alike'  # classes take turns; '0p5pct': as they come
