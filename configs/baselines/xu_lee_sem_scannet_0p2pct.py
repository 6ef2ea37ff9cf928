# Xu and Lee on 0.2 % of the points of ScanNet, with the network and schedule of rm3d_sem_scannet_0p2pct.
# Run: rm3d train xu_lee_sem_scannet_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/scannet.py'
budget = '0p2pct'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
aug_prob = 1.0
aug_loss = dict(loss=dict(type='DivergenceLoss', convention='xu_lee', loss_weight=10.0), num_points=None)
method_loss = dict(type='ScheduledLoss', start=0.5, losses=['${aug_loss}', dict(type='XuLeeLoss')])
losses = ['${point_loss}', '${method_loss}']
model = dict(refine=dict(type='XuLeePropagation'))
