# Weak baseline: the network and schedule of rm3d_sem_semantic3d_0p2pct on the annotated points alone.
# Run: rm3d train sup_sem_semantic3d_0p2pct [--demo]
# Time: not measured.
# Score on Semantic3D: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/semantic3d.py'
budget = '0p2pct'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
