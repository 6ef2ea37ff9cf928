# Viewpoint Bottleneck: classes of points of SemanticKITTI, from 0.2 % of the points; the network and schedule of rm3d_sem_semantickitti_0p2pct.
# Run: rm3d train viewpoint_bottleneck_sem_semantickitti_0p2pct [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/semantickitti.py'
budget = '0p2pct'
label_refreshes = 1
propagate = False
method_hook = dict(
    type='PretrainingHook', loss=dict(type='ViewpointBottleneck', in_channels='${widths[0]}'), cache='${cache_dir}'
)
