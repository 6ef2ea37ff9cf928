# Contrastive descriptor, from the rooms of ScanNet, without labels.
# Run: rm3d train contrastive_rooms [--demo]
# Time: not measured.
# Score on ScanNet: not measured (the data set is not part of the repository).
_base_ = '../_base_/contrastive.py'
data = 'rooms'
