# RM3D, classes of points of SemanticKITTI, from 0.2 % of the points.
# Run: rm3d train rm3d_sem_semantickitti_0p2pct [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = './_base_/semantickitti.py'
budget = '0p2pct'
