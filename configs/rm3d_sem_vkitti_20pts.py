# RM3D, classes of points of vKITTI 3D, from 20 labelled points a scene.
# Run: rm3d train rm3d_sem_vkitti_20pts [--demo]
# Time: not measured.
# Score on vKITTI 3D: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/vkitti.py'
budget = '20pts'
# So few labelled points say little: with more of the loss they make it noisy.
annotated_share = 0.1
ground = dict(max_distance=3.0)  # m; they say nothing of ground further off
