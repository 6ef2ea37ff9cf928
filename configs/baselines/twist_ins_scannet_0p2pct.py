# TWIST on 0.2 % of the points of ScanNet, instances, with the network and schedule of rm3d_ins_scannet_0p2pct.
# Run: rm3d train twist_ins_scannet_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/scannet.py'
task = 'instances'
budget = '0p2pct'
label_refreshes = 1  # the first labels stay
propagate = False  # training sees the annotated points alone
dice_loss = None
offset_weight = 0.0  # few points do not tell the middle of their object: sure objects do
method_loss = dict(type='TwistLoss', num_classes='${num_classes}', channels='${widths[0]}')
method_loss.update(thing_classes='${thing_classes}', proposals='${point_group.proposals}')
method_hook = dict(type='EMATeacherHook')
