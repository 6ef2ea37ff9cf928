# CPCM: classes of points of SemanticKITTI, from 0.2 % of the points; the network and schedule of rm3d_sem_semantickitti_0p2pct.
# Run: rm3d train cpcm_sem_semantickitti_0p2pct [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/semantickitti.py'
budget = '0p2pct'
label_refreshes = 1
propagate = False
aug_prob = 1.0
aug_loss = None
method_view = dict(type='MaskedView')
method_loss = dict(
    type='ScheduledLoss',
    losses=[
        dict(type='ViewSupervision', loss='${point_loss}'),
        dict(type='ScheduledLoss', ramp=0.028, losses=[dict(type='MaskedConsistency')]),
    ],
)
