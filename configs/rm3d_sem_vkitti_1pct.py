# RM3D, classes of points of vKITTI 3D, from 1 % of the points.
# Run: rm3d train rm3d_sem_vkitti_1pct [--demo]
# Time: not measured.
# Score on vKITTI 3D: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/vkitti.py'
budget = '1pct'
