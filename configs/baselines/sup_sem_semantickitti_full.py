# Full supervision: the network and schedule of rm3d_sem_semantickitti_* on all labels.
# Run: rm3d train sup_sem_semantickitti_full [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/semantickitti.py'
budget = 'full'
label_refreshes = 1  # the labels stay
propagate = False  # all points have a label
