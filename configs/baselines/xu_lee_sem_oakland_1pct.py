# Xu and Lee: classes of points of Oakland, from 1 % of the points; the network and schedule of rm3d_sem_oakland_1pct.
# Run: rm3d train xu_lee_sem_oakland_1pct
# Time: not measured.
# Score on Oakland: docs/RESULTS.md.
_base_ = '../_base_/oakland.py'
budget = '1pct'
label_refreshes = 1
propagate = False
aug_prob = 1.0
aug_loss = None
method_loss = dict(
    type='ScheduledLoss',
    start=0.5,
    losses=[
        dict(type='ViewConsistency', loss=dict(type='DivergenceLoss', convention='xu_lee', loss_weight=10.0)),
        dict(type='XuLeeLoss', channels=0),
    ],
)
model = dict(refine=dict(type='XuLeePropagation', channels=0))
