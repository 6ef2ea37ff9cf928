# Weak baseline: the network and schedule of rm3d_sem_semantickitti_20pts on the annotated points alone.
# Run: rm3d train sup_sem_semantickitti_20pts [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/semantickitti.py'
budget = '20pts'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
