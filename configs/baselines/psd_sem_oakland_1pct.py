# PSD: classes of points of Oakland, from 1 % of the points; the network and schedule of rm3d_sem_oakland_1pct.
# Run: rm3d train psd_sem_oakland_1pct
# Time: not measured.
# Score on Oakland: docs/RESULTS.md.
_base_ = '../_base_/oakland.py'
budget = '1pct'
label_refreshes = 1
propagate = False
aug_prob = 1.0
aug_loss = dict(loss=dict(type='DivergenceLoss', convention='psd'))
method_loss = dict(
    type='ScheduledLoss',
    losses=[dict(type='ViewSupervision', loss='${point_loss}'), dict(type='RelationLoss', channels='${widths[0]}')],
)
