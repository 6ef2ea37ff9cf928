# Full supervision: the network and schedule of rm3d_ins_scannet_* on all labels.
# Run: python tools/train.py configs/sup_ins_scannet_full.py [--demo]
# Score on ScanNet: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_scannet.py', './_base_/budgets/points_full.py']
label_refreshes = 1  # the labels stay
propagate = False  # nothing is left to propagate to
