# RM3D semantic segmentation of Oakland from 0.1 % of the points.
# Run: python tools/train.py configs/rm3d_sem_oakland_0p1pct.py --cfg-options data_root=FOLDER
# Score on Oakland's test tiles: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_oakland.py', './_base_/budgets/points_0p1pct.py']
