# RM3D instance segmentation of ScanNet from 20 labelled points a scene.
# Run: python tools/train.py configs/rm3d_ins_scannet_20pts.py [--demo]
# Score on ScanNet: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/ins_scannet.py', './_base_/budgets/points_20pts.py']
