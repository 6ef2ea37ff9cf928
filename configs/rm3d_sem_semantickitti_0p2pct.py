# RM3D semantic segmentation of SemanticKITTI from 0.2 % of the points.
# Run: python tools/train.py configs/rm3d_sem_semantickitti_0p2pct.py [--demo]
# Score on SemanticKITTI: not measured (the data set is not part of the repository). Demo scores: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_semantickitti.py', './_base_/budgets/points_0p2pct.py']
