# Contrastive descriptor, from rooms and streets together, without labels: with --demo the weights of the package.
# Run: rm3d train contrastive_both [--demo]
# Time: not measured; docs/learned_descriptors.md tells of the demo.
# Score on ScanNet and SemanticKITTI: not measured (the data sets are not part of the repository).
_base_ = '../_base_/contrastive.py'
data = 'both'
streets_root = 'data/semantickitti'
negative_distance = 5.0  # voxels, 0.25 m of a room: a match is right within 0.1 m; 16 as METHOD 3 has it
streets = dict(root='data/descriptor_streets', scenes='semantickitti_streets', num_train=20, num_val=4, seed=0)
demo = dict(streets_root='data/descriptor_streets', more_demo_data=[streets], sigma=20, learning_rate=3e-3)
del streets
