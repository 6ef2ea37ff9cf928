# PSD: classes and instances of ScanNet, from 0.2 % of the points; the network and schedule of rm3d_ins_scannet_0p2pct.
# Run: rm3d train psd_ins_scannet_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/scannet.py'
task = 'instances'
budget = '0p2pct'
label_refreshes = 1
propagate = False
dice_loss = None
offset_weight = 0.0
point_group = dict(proposals=dict(coordinates='original'))
aug_prob = 1.0
aug_loss = dict(loss=dict(type='DivergenceLoss', convention='psd'))
method_loss = dict(
    type='ScheduledLoss',
    losses=[dict(type='ViewSupervision', loss='${point_loss}'), dict(type='RelationLoss', channels='${widths[0]}')],
)
