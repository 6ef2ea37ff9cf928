# CSC: classes of points of ScanNet, from 0.2 % of the points; the network and schedule of rm3d_sem_scannet_0p2pct.
# Run: rm3d train csc_sem_scannet_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/scannet.py'
budget = '0p2pct'
label_refreshes = 1
propagate = False
method_hook = dict(
    type='PretrainingHook', loss=dict(type='SceneContexts', in_channels='${widths[0]}'), cache='${cache_dir}'
)
