# RM3D, classes of points of ScanNet, from 20 labelled points a scene.
# Run: rm3d train rm3d_sem_scannet_20pts [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = './_base_/scannet.py'
budget = '20pts'
