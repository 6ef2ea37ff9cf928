# RM3D, classes of points of SemanticKITTI, from 20 labelled points a scene.
# Run: rm3d train rm3d_sem_semantickitti_20pts [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = './_base_/semantickitti.py'
budget = '20pts'
# So few labelled points say little: with more of the loss they make it noisy.
annotated_share = 0.1
ground = dict(max_distance=3.0)  # m; they say nothing of ground further off
