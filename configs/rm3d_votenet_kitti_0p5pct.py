# RM3D, boxes of KITTI, from one labelled box per ten frames.
# Run: rm3d train rm3d_votenet_kitti_0p5pct [--demo]
# Time: not measured.
# Score on KITTI: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/kitti.py'
budget = dict(
    per_scene=0.1, alike=True
)  # as many of each class as of another while there are any; '0p5pct': as they come
