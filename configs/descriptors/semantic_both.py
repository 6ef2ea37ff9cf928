# Semantic, from rooms and streets together, with all their labels: with --demo the weights of the package.
# Run: rm3d train semantic_both [--demo]
# Time: with --demo 13 min on one of two cores, beside two other processes; else not measured.
# Score on ScanNet, SemanticKITTI, Semantic3D and VKITTI: not measured (the data sets are not part of the repository).
_base_ = '../_base_/semantic.py'
data = 'both'
streets_root, stations_root, frames_root = 'data/semantickitti', 'data/semantic3d', 'data/vkitti'
