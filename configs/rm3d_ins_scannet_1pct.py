# RM3D instance segmentation of ScanNet from 1 % of the points.
# Run: python tools/train.py configs/rm3d_ins_scannet_1pct.py [--demo]
# Score on ScanNet: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_scannet.py', './_base_/budgets/points_1pct.py']
# Many things have an annotated point here; regions that are named without one would teach classes and no instances.
region_prior = None
