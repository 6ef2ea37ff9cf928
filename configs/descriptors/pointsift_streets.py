# Point-SIFT, from the scans of SemanticKITTI, without labels.
# Run: rm3d train pointsift_streets [--demo]
# Time: not measured.
# Score on SemanticKITTI: not measured (the data set is not part of the repository).
_base_ = '../_base_/pointsift.py'
data = 'streets'
data_root = 'data/semantickitti'
demo = dict(
    data_root='data/descriptor_streets',
    demo_data=dict(scenes='semantickitti_streets', num_train=20, num_val=4, seed=0),
)
