# Semantic, from rooms and streets together, with all their labels: with --demo the weights of the package.
# Run: rm3d train semantic_both [--demo]
# Time: with --demo 13 min on one of two cores, beside two other processes; else not measured.
# Score on ScanNet, SemanticKITTI, Semantic3D and VKITTI: not measured (the data sets are not part of the repository).
_base_ = '../_base_/semantic.py'
data = 'both'
streets_root, stations_root, frames_root = 'data/semantickitti', 'data/semantic3d', 'data/vkitti'
site_classes = [20, 19, 8, 13]
scenes = dict(
    _delete_=True,
    both=[
        dict(type='ScanNetDataset', data_root='${data_root}', split='train', pipeline=[dict(type='AllLabels')]),
        dict(
            type='SemanticKittiDataset',
            data_root='${streets_root}',
            split='train',
            pipeline=[dict(type='AllLabels', first_class=20)],
        ),
        dict(
            type='Semantic3DDataset',
            data_root='${stations_root}',
            split='train',
            pipeline=[dict(type='AllLabels', first_class=39)],
        ),
        dict(
            type='VKITTI3DDataset',
            data_root='${frames_root}',
            split='train',
            pipeline=[dict(type='AllLabels', first_class=47)],
        ),
    ],
)
demo = dict(
    # scenes of a seed that no other demo and no table has: their labels are all seen
    demo_data=dict(scenes='scannet_rooms', num_train=60, num_val=1, seed=101),
    data_root='data/descriptor_semantic/rooms',
    streets_root='data/descriptor_semantic/streets',
    stations_root='data/descriptor_semantic/stations',
    frames_root='data/descriptor_semantic/frames',
    more_demo_data=[
        dict(
            root='data/descriptor_semantic/streets', scenes='semantickitti_streets', num_train=60, num_val=1, seed=101
        ),
        dict(root='data/descriptor_semantic/stations', scenes='semantic3d_streets', num_train=12, num_val=1, seed=101),
        dict(root='data/descriptor_semantic/frames', scenes='vkitti_streets', num_train=30, num_val=1, seed=101),
    ],
    sigma=14,
)
