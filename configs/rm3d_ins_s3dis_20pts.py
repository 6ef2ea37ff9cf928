# RM3D instance segmentation of S3DIS from 20 labelled points a scene.
# Run: python tools/train.py configs/rm3d_ins_s3dis_20pts.py [--demo]
# Score on S3DIS: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_s3dis.py', './_base_/budgets/points_20pts.py']
