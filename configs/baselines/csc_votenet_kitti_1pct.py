# CSC: boxes of KITTI, from 1 % of the boxes; the network and schedule of rm3d_votenet_kitti_1pct.
# Run: rm3d train csc_votenet_kitti_1pct [--demo]
# Time: not measured.
# Score on KITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/kitti.py'
budget = dict(
    per_scene=0.2, alike=True
)  # as many of each class as of another while there are any; '1pct': as they come
label_refreshes = 1
method_hook = dict(
    type='PretrainingHook', loss=dict(type='SceneContexts', in_channels='${widths[0]}'), cache='${cache_dir}'
)
