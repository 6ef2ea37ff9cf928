# RM3D instance segmentation of S3DIS from 1 % of the points.
# Run: python tools/train.py configs/rm3d_ins_s3dis_1pct.py [--demo]
# Score on S3DIS: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_s3dis.py', './_base_/budgets/points_1pct.py']
# Many things have an annotated point here; regions that are named without one would teach classes and no instances.
region_prior = None
