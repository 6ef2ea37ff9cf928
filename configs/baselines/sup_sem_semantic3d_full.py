# Full supervision: the network and schedule of rm3d_sem_semantic3d_* on all labels.
# Run: rm3d train sup_sem_semantic3d_full [--demo]
# Time: not measured.
# Score on Semantic3D: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/semantic3d.py'
budget = 'full'
label_refreshes = 1  # the labels stay
propagate = False  # all points have a label
