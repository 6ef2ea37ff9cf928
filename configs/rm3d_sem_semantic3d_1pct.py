# RM3D, classes of points of Semantic3D, from 1 % of the points.
# Run: rm3d train rm3d_sem_semantic3d_1pct [--demo]
# Time: not measured.
# Score on Semantic3D: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/semantic3d.py'
budget = '1pct'
