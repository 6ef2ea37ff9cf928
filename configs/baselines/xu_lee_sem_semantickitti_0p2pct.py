# Xu and Lee: classes of points of SemanticKITTI, from 0.2 % of the points; the network and schedule of rm3d_sem_semantickitti_0p2pct.
# Run: rm3d train xu_lee_sem_semantickitti_0p2pct [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/semantickitti.py'
budget = '0p2pct'
label_refreshes = 1
propagate = False
aug_prob = 1.0
aug_loss = None
method_loss = dict(
    type='ScheduledLoss',
    start=0.5,
    losses=[
        dict(type='ViewConsistency', loss=dict(type='DivergenceLoss', convention='xu_lee', loss_weight=10.0)),
        dict(type='XuLeeLoss', channels=1),
    ],
)
model = dict(refine=dict(type='XuLeePropagation', channels=1))
