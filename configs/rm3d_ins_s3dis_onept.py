# RM3D instance segmentation of S3DIS from one labelled point per class and scene.
# Run: python tools/train.py configs/rm3d_ins_s3dis_onept.py [--demo]
# Score on S3DIS: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_s3dis.py', './_base_/budgets/points_onept.py']
# A class has one label a scene: nothing corrects one that propagates too far.
propagation = dict(max_extent=1.75)
