# Full supervision: the network and schedule of rm3d_ins_s3dis_* on all labels.
# Run: python tools/train.py configs/sup_ins_s3dis_full.py [--demo]
# Score on S3DIS: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_s3dis.py', './_base_/budgets/points_full.py']
label_refreshes = 1  # the labels stay
propagate = False  # nothing is left to propagate to
