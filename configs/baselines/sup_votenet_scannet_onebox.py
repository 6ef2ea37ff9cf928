# Weak baseline: the network and schedule of rm3d_votenet_scannet_onebox on the labelled boxes alone.
# Run: rm3d train sup_votenet_scannet_onebox [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/scannet_boxes.py'
budget = 'onebox'
label_refreshes = 1  # the first labels stay
