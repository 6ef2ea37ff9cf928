# RM3D, classes and instances of points of ScanNet, from 20 labelled points a scene.
# Run: rm3d train rm3d_ins_scannet_20pts [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = './_base_/scannet.py'
task = 'instances'
budget = '20pts'
