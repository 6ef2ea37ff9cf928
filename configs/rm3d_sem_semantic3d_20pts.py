# RM3D, classes of points of Semantic3D, from 20 labelled points a scene.
# Run: rm3d train rm3d_sem_semantic3d_20pts [--demo]
# Time: not measured.
# Score on Semantic3D: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/semantic3d.py'
budget = '20pts'
# So few labelled points say little: with more of the loss they make it noisy.
annotated_share = 0.1
ground = dict(max_distance=3.0)  # m; they say nothing of ground further off
