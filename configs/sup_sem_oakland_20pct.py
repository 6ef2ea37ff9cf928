# Weak baseline: the network and schedule of rm3d_sem_oakland_20pct on the annotated points alone.
# Run: python tools/train.py configs/sup_sem_oakland_20pct.py --cfg-options data_root=FOLDER
# Score on Oakland's test tiles: docs/RESULTS.md.
_base_ = ['./_base_/variants/sem_oakland.py', './_base_/budgets/points_20pct.py']
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
