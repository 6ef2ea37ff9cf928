# Weak baseline: the network and schedule of rm3d_ins_s3dis_0p2pct on the annotated points alone.
# Run: python tools/train.py configs/sup_ins_s3dis_0p2pct.py [--demo]
# Score on S3DIS: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_s3dis.py', './_base_/budgets/points_0p2pct.py']
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
dice_loss = None  # the middle of a few annotated points is not that of their object
point_group = dict(offset_loss=dict(loss_weight=0.0), proposals=dict(coordinates='original'))  # no offsets
