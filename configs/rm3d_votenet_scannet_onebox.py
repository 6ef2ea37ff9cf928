# RM3D, boxes of ScanNet, from one labelled object in each room.
# Run: rm3d train rm3d_votenet_scannet_onebox [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/scannet_boxes.py'
budget = 'onebox'
