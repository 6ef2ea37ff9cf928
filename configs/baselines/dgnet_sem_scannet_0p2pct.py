# DGNet: classes of points of ScanNet, from 0.2 % of the points; the network and schedule of rm3d_sem_scannet_0p2pct.
# Run: rm3d train dgnet_sem_scannet_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/scannet.py'
budget = '0p2pct'
label_refreshes = 1
propagate = False
point_loss = dict(loss=dict(type='TruncatedCrossEntropyLoss'))
method_loss = dict(
    type='ScheduledLoss',
    start=0.5,
    losses=[dict(type='DGNetLoss', num_classes='${num_classes}', channels='${widths[0]}')],
)
