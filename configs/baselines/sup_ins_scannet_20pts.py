# Weak baseline: the network and schedule of rm3d_ins_scannet_20pts on the annotated points alone.
# Run: rm3d train sup_ins_scannet_20pts [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/scannet.py'
task = 'instances'
budget = '20pts'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
dice_loss = None  # the middle of a few annotated points is not that of their object
offset_weight = 0.0  # for the same reason
point_group = dict(proposals=dict(coordinates='original'))  # clusters of the points as they lie
