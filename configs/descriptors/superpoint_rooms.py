# Supervised superpoints, from the rooms of ScanNet with all their labels.
# Run: rm3d train superpoint_rooms [--demo]: with --demo the weights of the package.
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository).
_base_ = '../_base_/superpoint.py'
budget = 'full'
propagate = False  # all points have a label
