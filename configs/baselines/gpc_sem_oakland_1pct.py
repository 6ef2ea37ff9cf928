# GPC: classes of points of Oakland, from 1 % of the points; the network and schedule of rm3d_sem_oakland_1pct.
# Run: rm3d train gpc_sem_oakland_1pct
# Time: not measured.
# Score on Oakland: docs/RESULTS.md.
_base_ = '../_base_/oakland.py'
budget = '1pct'
label_refreshes = 1
propagate = False
aug_loss = None
aug_prob = 0.0
method_view = dict(type='AugmentedView', crop=[0.4, 0.8])
method_loss = dict(
    type='ScheduledLoss',
    start=0.005,
    losses=[dict(type='GuidedContrast', in_channels='${widths[0]}', num_classes='${num_classes}')],
)
