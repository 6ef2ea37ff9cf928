# CPCM on 0.2 % of the points of ScanNet, with the network and schedule of rm3d_sem_scannet_0p2pct.
# Run: rm3d train cpcm_sem_scannet_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/scannet.py'
budget = '0p2pct'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
aug_prob = 1.0
method_view = dict(type='MaskedView')
method_loss = dict(type='ScheduledLoss', ramp=0.028, losses=[dict(type='MaskedConsistency')])  # 5 of 180 epochs
losses = ['${point_loss}', dict(type='ViewSupervision', loss='${point_loss}'), '${method_loss}']
