# Weak baseline: the network and schedule of rm3d_votenet_waymo_1pct on the labelled boxes alone.
# Run: rm3d train sup_votenet_waymo_1pct [--demo]
# Time: not measured.
# Score on Waymo: not measured (the data set is not part of the repository). On the demo: not measured.
_base_ = '../_base_/waymo.py'
budget = '1pct_alike'  # classes take turns; '1pct': as they come
label_refreshes = 1  # the first labels stay
