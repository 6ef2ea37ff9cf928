# Predator, from rooms and streets together, without labels: with --demo the weights of the package.
# Run: rm3d train predator_both [--demo]
# Time: not measured; docs/learned_descriptors.md tells of the demo.
# Score on ScanNet and SemanticKITTI: not measured (the data sets are not part of the repository).
_base_ = '../_base_/predator.py'
data = 'both'
streets_root = 'data/semantickitti'
streets = dict(root='data/descriptor_streets', scenes='semantickitti_streets', num_train=20, num_val=4, seed=0)
demo = dict(streets_root='data/descriptor_streets', more_demo_data=[streets], sigma=6)
del streets
