# GPC: classes of points of SemanticKITTI, from 0.2 % of the points; the network and schedule of rm3d_sem_semantickitti_0p2pct.
# Run: rm3d train gpc_sem_semantickitti_0p2pct [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/semantickitti.py'
budget = '0p2pct'
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
