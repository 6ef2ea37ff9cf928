# Point-SIFT, from the rooms of ScanNet, without labels.
# Run: rm3d train pointsift_rooms [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository).
_base_ = '../_base_/pointsift.py'
data = 'rooms'
