# Full supervision: the network and schedule of rm3d_sem_vkitti_* on all labels.
# Run: rm3d train sup_sem_vkitti_full [--demo]
# Time: not measured.
# Score on vKITTI 3D: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/vkitti.py'
budget = 'full'
label_refreshes = 1  # the labels stay
propagate = False  # all points have a label
