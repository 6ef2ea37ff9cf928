# RM3D instance segmentation of ScanNet from 0.2 % of the points.
# Run: python tools/train.py configs/rm3d_ins_scannet_0p2pct.py [--demo]
# Score on ScanNet: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_scannet.py', './_base_/budgets/points_0p2pct.py']
# Many things have an annotated point here; regions that are named without one would teach classes and no instances.
region_prior = None
