# Supervised superpoints in rooms: a small PointNet on 20 neighbours, from objects: labelled points, instances where there
# are any, and what spreads from them. Lengths in voxels, as wide as the density of a scan asks for.
_base_ = './indoor.py'
dataset_type = 'ScanNetDataset'
data_root = 'data/scannet'
num_classes = 20
thing_classes = [2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]
point_columns = ['rgb']
task = 'instances'
instance_metric = 'InstanceSegMetric'
label_refreshes = 1  # the labels stay
train_pipeline = [
    dict(type='RandomCrop', max_points='${crop_points}', shape='column'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[1.0, 1.0]),
    dict(type='PointNoise', jitter=0.003),
    dict(type='ObjectSites'),
    dict(type='PackScene'),
]
model = dict(
    _delete_=True,
    type='DescriptorNetwork',
    backbone=dict(type='LocalCloudEmbedder'),
    channels=4,
    in_channels=7,  # what a site tells of its surroundings
    losses=[dict(type='GraphContrast')],
)
custom_hooks = [
    dict(type='EpochSeedHook'),
    dict(
        type='RegionMergeHook',
        interval='${sigma}',
        rounds='${label_refreshes}',
        dataloader='${label_dataloader}',
        label_maker='${label_maker}',
    ),
    dict(type='SafeCheckpointHook'),
    dict(type='RunRecordHook'),
    dict(type='DescriptorWeightsHook'),
]
rounds = 1
sigma = 50  # epochs; METHOD 3
learning_rate = 1e-2
val_dataloader = None
val_evaluator = None
val_cfg = None
test_dataloader = None
test_evaluator = None
test_cfg = None
demo = dict(
    demo_data=dict(scenes='scannet_rooms', num_train=20, num_val=4, seed=0),
    data_root='data/descriptor_rooms',
    crop_points=8000,
    rounds=1,
    sigma=10,
)
