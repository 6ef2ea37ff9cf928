# RM3D, classes and instances of points of ScanNet, from one labelled point per class and scene.
# Run: rm3d train rm3d_ins_scannet_onept [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = './_base_/scannet.py'
task = 'instances'
budget = 'onept'
# A class has one label a scene: nothing corrects one that propagates too far.
propagation = dict(max_extent=1.75)
