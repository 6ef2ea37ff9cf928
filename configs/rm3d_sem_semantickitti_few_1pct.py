# RM3D semantic segmentation of three scans of SemanticKITTI's sequence 00 from 1 % of the points, measured on 01 and 99.
# Run: python tools/train.py configs/rm3d_sem_semantickitti_few_1pct.py --cfg-options data_root=FOLDER [--demo]
# Score on SemanticKITTI: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_semantickitti_few.py', './_base_/budgets/points_1pct.py']
