# RM3D, classes of points of vKITTI 3D, from 0.2 % of the points.
# Run: rm3d train rm3d_sem_vkitti_0p2pct [--demo]
# Time: not measured.
# Score on vKITTI 3D: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = './_base_/vkitti.py'
budget = '0p2pct'
