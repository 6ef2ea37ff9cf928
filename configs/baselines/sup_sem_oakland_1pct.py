# Weak baseline: the network and schedule of rm3d_sem_oakland_1pct on the annotated points alone.
# Run: rm3d train sup_sem_oakland_1pct --cfg-options data_root=FOLDER
# Time: not measured.
# Score on the test tiles: docs/RESULTS.md.
_base_ = '../_base_/oakland.py'
budget = '1pct'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
