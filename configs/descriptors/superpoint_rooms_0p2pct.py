# Supervised superpoints, from 0.2 % of the points of ScanNet's rooms and what spreads from these.
# Run: rm3d train superpoint_rooms_0p2pct [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository).
_base_ = '../_base_/superpoint.py'
budget = '0p2pct'
