# PSD on 0.2 % of the points of SemanticKITTI, with the network and schedule of rm3d_sem_semantickitti_0p2pct.
# Run: rm3d train psd_sem_semantickitti_0p2pct [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/semantickitti.py'
budget = '0p2pct'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
aug_prob = 1.0
aug_loss = dict(loss=dict(type='DivergenceLoss', convention='psd'), num_points=None)
method_loss = dict(type='RelationLoss', channels='${widths[0]}')
losses = ['${point_loss}', dict(type='ViewSupervision', loss='${point_loss}'), '${aug_loss}', '${method_loss}']
