# Learned descriptors from scans without labels, all but the network: pairs of crops of one scan, the schedule, and what
# --demo changes. A descriptor's page (contrastive.py, predator.py) goes on from here.

custom_imports = dict(imports=['rm3d_plugin'], allow_failed_imports=False)
default_scope = 'rm3d_plugin'
seed = 0
threads = 0  # of our kernels; 0 = one for each core
num_workers = 0
accumulate = 1  # batches a step of the optimizer
checkpoint_interval = 1  # epochs
randomness = dict(seed='${seed}', deterministic=True)
env_cfg = dict(cudnn_benchmark=False, mp_cfg=dict(mp_start_method='fork', opencv_num_threads=0))
default_hooks = dict(
    timer=dict(type='IterTimerHook'),
    logger=dict(type='LoggerHook', interval=20, ignore_last=False, log_metric_by_epoch=True),
    param_scheduler=dict(type='ParamSchedulerHook'),
    sampler_seed=dict(type='DistSamplerSeedHook'),
    checkpoint=dict(
        type='CheckpointHook',
        interval='${checkpoint_interval}',
        max_keep_ckpts=2,
        backend_args=dict(backend='rm3d_atomic'),
    ),
)
log_level = 'INFO'
visualizer = None

# --- Data: the training scans of rooms, streets or both, or your own, without labels
data = 'rooms'  # 'streets'; 'both'; 'files': all scans of data_root
data_root = 'data/scannet'
streets_root = '${data_root}'  # of 'both'
scenes = dict(
    rooms=['${room_scans}'],
    streets=[dict(type='SemanticKittiDataset', data_root='${data_root}', split='train')],
    files=[dict(type='FilesDataset', data_root='${data_root}')],
    both=['${room_scans}', dict(type='SemanticKittiDataset', data_root='${streets_root}', split='train')],
)
room_scans = dict(type='ScanNetDataset', data_root='${data_root}', split='train')
crop_points = 20000  # of each crop, before it is thinned
overlap = [0.3, 0.9]  # share of its points that a crop has in common with the other
keep = [0.5, 1.0]  # share of a crop's points that stay: crops differ in density
jitter = 0.005  # m
histograms = True  # a site tells how normals turn around it, too
train_pipeline = [
    dict(type='CropPairs', points='${crop_points}', overlap='${overlap}', keep='${keep}', jitter='${jitter}'),
    dict(type='VoxelUnits', histograms='${histograms}'),
    dict(type='PackScene'),
]
train_dataloader = dict(
    batch_size='${batch_size}',
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='EpochSampler', shuffle=True),
    dataset=dict(type='JoinedScenes', scenes='${scenes.${data}}', seed='${seed}', pipeline='${train_pipeline}'),
)

# --- Network: sites are voxels as wide as the density of a scan asks for; lengths are in voxels
widths = [32, 48, 64]
blocks = 1
channels = 32  # values of a descriptor
backbone = dict(type='SparseUNet', voxel_size=1.0, widths='${widths}', blocks='${blocks}', map_cache=0)

load_from = None  # checkpoint whose weights of the same names and shapes are the start, of another descriptor too

# --- Schedule
rounds = 1
sigma = 100  # epochs
batch_size = 4
learning_rate = 1e-3
train_cfg = dict(type='EpochBasedTrainLoop', max_epochs='${epochs}')
optim_wrapper = dict(
    type='OptimWrapper',
    optimizer=dict(type='Adam', lr='${learning_rate}'),
    clip_grad=dict(max_norm=10.0),
    accumulative_counts='${accumulate}',
)
param_scheduler = [
    dict(type='CosineAnnealingLR', by_epoch=True, convert_to_iter_based=True, T_max='${epochs}', eta_min=1e-5)
]
custom_hooks = [
    dict(type='EpochSeedHook'),
    dict(type='SafeCheckpointHook'),
    dict(type='RunRecordHook'),
    dict(type='DescriptorWeightsHook'),
]

# --- What --demo changes: data, sizes, epochs
demo = dict(
    data_root='data/descriptor_rooms',
    demo_data=dict(scenes='scannet_rooms', num_train=20, num_val=4, seed=0),
    crop_points=8000,
    sigma=20,
    batch_size=1,
    learning_rate=2e-3,
)
