# Full supervision: the network and schedule of rm3d_votenet_kitti_* on all boxes.
# Run: rm3d train sup_votenet_kitti_full [--demo]
# Time: not measured.
# Score on KITTI: not measured (the data set is not part of the repository). On the demo: docs/RESULTS.md.
_base_ = '../_base_/kitti.py'
budget = 'full'
label_refreshes = 1  # the first labels stay
