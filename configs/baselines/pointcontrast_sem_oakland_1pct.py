# PointContrast: classes of points of Oakland, from 1 % of the points; the network and schedule of rm3d_sem_oakland_1pct.
# Run: rm3d train pointcontrast_sem_oakland_1pct
# Time: not measured.
# Score on Oakland: docs/RESULTS.md.
_base_ = '../_base_/oakland.py'
budget = '1pct'
label_refreshes = 1
propagate = False
method_hook = dict(
    type='PretrainingHook',
    loss=dict(type='PointContrast', in_channels='${widths[0]}', voxel_size='${voxel_size}'),
    cache='${cache_dir}',
)
