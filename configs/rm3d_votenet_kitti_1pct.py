# RM3D, boxes of KITTI, from two labelled boxes per ten frames.
# Run: rm3d train rm3d_votenet_kitti_1pct [--demo]
# Time: make demo took 5 min 18 s on two cores.
# Score on KITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = './_base_/kitti.py'
budget = dict(
    per_scene=0.2, alike=True
)  # as many of each class as of another while there are any; '1pct': as they come
