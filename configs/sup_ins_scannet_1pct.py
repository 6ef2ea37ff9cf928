# Weak baseline: the network and schedule of rm3d_ins_scannet_1pct on the annotated points alone.
# Run: python tools/train.py configs/sup_ins_scannet_1pct.py [--demo]
# Score on ScanNet: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_scannet.py', './_base_/budgets/points_1pct.py']
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
dice_loss = None  # the middle of a few annotated points is not that of their object
point_group = dict(min_instance_points=10)  # of objects with fewer, no offset is taught
