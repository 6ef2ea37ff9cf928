# Full supervision: the network and schedule of rm3d_votenet_waymo_* on all boxes.
# Run: rm3d train sup_votenet_waymo_full [--demo]
# Time: not measured.
# Score on Waymo: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/waymo.py'
budget = 'full'
label_refreshes = 1  # the first labels stay
