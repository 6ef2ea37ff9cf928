# Full supervision: the network and schedule of rm3d_sem_semantickitti_few_1pct on all labels.
# Run: rm3d train sup_sem_semantickitti_few_full --cfg-options data_root=FOLDER [--demo]
# Time: not measured.
# Score on real scans: docs/RESULTS.md.
_base_ = '../_base_/semantickitti_few.py'
budget = 'full'
label_refreshes = 1  # the labels stay
propagate = False  # all points have a label
