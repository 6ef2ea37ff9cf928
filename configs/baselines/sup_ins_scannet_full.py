# Full supervision: the network and schedule of rm3d_ins_scannet_* on all labels.
# Run: rm3d train sup_ins_scannet_full [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/scannet.py'
task = 'instances'
budget = 'full'
label_refreshes = 1  # the labels stay
propagate = False  # all points have a label
