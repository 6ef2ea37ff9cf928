# RM3D + ERDA: classes of points of ScanNet, from 0.2 % of the points; the network and schedule of rm3d_sem_scannet_0p2pct.
# Run: rm3d train rm3d_erda_sem_scannet_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/scannet.py'
budget = '0p2pct'
method_loss = dict(type='ERDALoss', num_classes='${num_classes}', channels='${widths[0]}')
