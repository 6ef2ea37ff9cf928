# ReDAL: classes and instances of ScanNet, from 0.2 % of the points; the network and schedule of rm3d_ins_scannet_0p2pct.
# Run: rm3d train redal_ins_scannet_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/scannet.py'
task = 'instances'
budget = '0p2pct'
label_refreshes = None
propagate = False
dice_loss = None
offset_weight = 0.0
point_group = dict(proposals=dict(coordinates='original'))
label_maker = dict(source=dict(type='RegionRoundsSource', rounds='${label_refreshes}', geometry='${region_geometry}'))
