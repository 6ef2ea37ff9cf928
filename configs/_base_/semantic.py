# A descriptor that learns the classes of labelled scans, all but the data: a sparse U-Net, and a linear layer for each data
# set that is dropped afterwards. Lengths in voxels, as wide as the density of a scan asks for.
_base_ = './pairs.py'
# --- Data: rooms, streets, stations and frames, whose classes have a block of numbers each
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
crop_points = 24000
keep = [0.35, 1.0]  # share of a crop's points that stay: crops differ in density
train_pipeline = [
    dict(type='RandomCrop', max_points='${crop_points}', shape='column', labelled=0.0),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.85, 1.15]),
    dict(type='PointNoise', jitter='${jitter}', columns=0.0),
    dict(type='RandomDownsample', keep='${keep}'),
    dict(type='ClassSites'),
    dict(type='PackScene'),
]
widths = [32, 48, 64]
model = dict(
    type='DescriptorNetwork',
    backbone='${backbone}',
    in_channels=44,  # of a site with histograms and heights
    channels='${channels}',
    losses=[dict(type='SiteClasses', channels='${channels}', classes='${site_classes}')],
)
# --- What --demo changes: data, sizes, epochs
demo = dict(
    crop_points=24000,
    batch_size=2,
    learning_rate=3e-3,
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
