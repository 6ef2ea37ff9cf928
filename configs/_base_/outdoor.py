# Classes of points in streets, all but the data set: how scenes are read, augmented and cut into regions, the network, the
# labels, the schedule, and what --demo changes. A data set's page (semantickitti.py, oakland.py, ...) goes on from here.

# --- Every run (the same in indoor.py, outdoor.py and detection.py)
custom_imports = dict(imports=['rm3d_plugin'], allow_failed_imports=False)
default_scope = 'rm3d_plugin'
seed = 0
threads = 0  # of our kernels; 0 = one for each core
num_workers = 0
accumulate = 1  # batches a step of the optimizer: a larger batch in the memory of a small one
cache_dir = 'work_dirs/geometry_cache'  # prepared scenes, keyed by content: runs share them
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

# --- Data
bad_scenes = 'error'  # 'skip' leaves unusable scenes out, with a counted warning
train_split = 'train'
val_split = 'val'
voxel_downsample = None  # m; keep one point in each cube of this edge
crop_points = 120000
recent_scenes = 16  # whose shapes and heights stay in memory
method_view = None  # of a compared method: a further view
aug_prob = 0.25  # share of scenes with a second view for L_Aug; 1, as the paper has it: a step costs half more
# METHOD 7. Heights are above the ground below a point, so slopes need not be learnt: the ground is found in the whole scene,
# before any crop.
train_pipeline = [
    dict(type='ColorAutoContrast'),
    dict(type='ColorJitter'),
    dict(type='ShapeFeatures', cache='${cache_dir}', recent='${recent_scenes}'),
    dict(type='HeightAboveGround', recent='${recent_scenes}'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.9, 1.1]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='AugmentedView', prob='${aug_prob}'),
    '${method_view}',
    dict(type='PackScene'),
]
eval_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}', recent='${recent_scenes}'),
    dict(type='HeightAboveGround', recent='${recent_scenes}'),
    dict(type='PackScene'),
]
train_dataloader = dict(
    batch_size='${batch_size}',
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='EpochSampler', shuffle=True),
    dataset=dict(
        type='${dataset_type}',
        data_root='${data_root}',
        split='${train_split}',
        voxel_downsample='${voxel_downsample}',
        labels='store',
        label_store='${work_dir}/labels',
        bad_scenes='${bad_scenes}',
        seed='${seed}',
        pipeline='${train_pipeline}',
    ),
)
# The training scenes once more, without labels and augmentation: what the network says of them makes the next labels.
label_dataloader = dict(
    batch_size=1,
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='DefaultSampler', shuffle=False),
    dataset=dict(
        type='${dataset_type}',
        data_root='${data_root}',
        split='${train_split}',
        voxel_downsample='${voxel_downsample}',
        labels='none',
        bad_scenes='${bad_scenes}',
        pipeline='${eval_pipeline}',
    ),
)
val_dataloader = dict(
    batch_size=1,
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='DefaultSampler', shuffle=False),
    dataset=dict(
        type='${dataset_type}',
        data_root='${data_root}',
        split='${val_split}',
        voxel_downsample='${voxel_downsample}',
        labels='truth',
        bad_scenes='${bad_scenes}',
        pipeline='${eval_pipeline}',
    ),
)
test_dataloader = '${val_dataloader}'

val_evaluator = [dict(type='SemSegMetric')]
test_evaluator = '${val_evaluator}'

# --- Network: the paper's sparse U-Net, m = 16, seven levels, two blocks, on 10 cm voxels. Heights above the ground are an
# input, but no places, which say nothing of a street and differ between crops and whole scenes.
voxel_size = 0.1  # m
widths = [16, 32, 48, 64, 80, 96, 112]
blocks = 2
height_scale = 5.0  # m of height that count 1; what is twice as high counts as that high
use_columns = '${point_columns}'  # []: a network that sees shapes only
tta_rotations = 1  # directions from which a scene is predicted
first_angle = 0.0  # degrees by which a scene is turned first
superpoint_smoothing = (
    0.0  # share of its region's mean in a point's probabilities; above 0 eval_pipeline has RegionNumbers
)
logit_adjustment = 0.0  # of the classes' annotated labels, at test time; larger: rare classes are said more rarely
model = dict(
    type='RM3DSegmentor',
    num_classes='${num_classes}',
    inputs=dict(columns='${point_columns}', use='${use_columns}', coordinates=False, height_scale='${height_scale}'),
    backbone=dict(type='SparseUNet', voxel_size='${voxel_size}', widths='${widths}', blocks='${blocks}'),
    semantic_head=dict(type='SemanticHead'),
    losses='${losses}',
    thing_classes='${thing_classes}',
    inference=dict(
        first_angle='${first_angle}',
        tta_rotations='${tta_rotations}',
        superpoint_smoothing='${superpoint_smoothing}',
        logit_adjustment='${logit_adjustment}',
    ),
)

# --- Losses (METHOD 7). One that is None is left out, and one of your own is a further entry.
losses = ['${point_loss}', '${aug_loss}', '${method_loss}']
class_balance = 'batch'  # by the labels of a batch; 'frequency': by the annotated labels; 'none'
class_power = 0.5  # weight of a class = labels of it ^ -0.5: wires and poles are a thousandth of the points
pseudo_weight = 1.0  # of a label that the budget did not show
confidence_power = 0.0  # 1: a label teaches as much as it is likely to be right; 0: all alike
annotated_share = 0.2  # of L_WSL that annotated labels have; those that propagate are mostly of wide flat things
method_loss = None  # of a compared method
method_hook = None  # of a compared method: a teacher, say, or pre-trained weights
labels_from = 'network'  # whose predictions make labels; 'teacher': its running mean (method_hook='${mean_teacher}')
mean_teacher = dict(type='EMATeacherHook', momentum=0.99)
point_loss = dict(
    type='WeakSupervision',
    balance='${class_balance}',
    power='${class_power}',
    pseudo_weight='${pseudo_weight}',
    annotated_share='${annotated_share}',
    confidence_power='${confidence_power}',
)
aug_loss = dict(type='ViewConsistency', loss=dict(type='JSAugLoss'))

# --- Labels: how points become regions and regions merge (METHOD 3, 5, 6). The ground, which has classes too, is cut into
# squares; what stands on it grows. How many of the first labels are right on real scans: docs/RESULTS.md.
budget_seed = '${seed}'  # a leaf says `budget`: docs/label_budgets.md
descriptor = dict(type='AdaptedPFH', radius=0.4, range_growth=0.1, max_neighbors=48)
oversegmenter = dict(
    type='GroundPatches',
    cell='${ground_cell}',
    rest=dict(
        type='RegionGrowing',
        threshold=0.9,
        zeta='${zeta}',
        min_region=10,
        max_edge='${region_reach}',
        range_growth='${region_reach_growth}',
    ),
)
ground_cell = 4.0  # m; far from the sensor points lie metres apart, and `ground` names them one by one
zeta = 0.05  # curvature up to which regions grow
region_reach = 0.3  # m between points of a region, at the sensor
region_reach_growth = 0.01  # m a metre of range, where the sensor is known
region_seeds = 'none'  # 'annotated': regions grow from the annotated points first; then each budget has its own
graph_neighbors = 8
max_gap = 0.6  # m between adjacent regions
propagate = True  # False: training sees the annotated points alone
strategy = 'default'  # labels spread by a random walk; 'regions': regions merge; 'paper': by `merge` alone
walker = dict()  # walker.accept=.7, say, for fewer and purer labels
random_walk = dict()
merge = dict(rounds='${label_refreshes}', centre_distance=1.0)
propagation = dict(max_extent=3.0)
region_prior = dict(
    classifier='kernel',  # a lidar sees all scans from one place, and as many points of each class may be annotated
    gamma=0.6,  # of prior and network together
    distance_scale=1.0,  # m: small things of a class stand anywhere
)
ground = dict(min_upright=0.95)
self_training = dict()  # self_training.cbst_fraction=.2, say; its defaults limit and check nothing
region_geometry = dict(  # for what asks for regions beside the label maker
    cache='${cache_dir}',
    descriptor='${descriptor}',
    oversegmenter='${oversegmenter}',
    graph_neighbors='${graph_neighbors}',
    max_gap='${max_gap}',
)
label_maker = dict(
    type='point_label_maker',
    store='${work_dir}/labels',
    cache='${cache_dir}',
    source=dict(
        type='PointBudgetSource', dataset='${label_dataloader.dataset}', budget='${budget}', seed='${budget_seed}'
    ),
    descriptor='${descriptor}',
    oversegmenter='${oversegmenter}',
    seeds='${region_seeds}',
    graph_neighbors='${graph_neighbors}',
    max_gap='${max_gap}',
    propagate='${propagate}',
    seed='${budget_seed}',
    strategy='${strategy}',
    walker='${walker}',
    random_walk='${random_walk}',
    merge='${merge}',
    propagation='${propagation}',
    region_prior='${region_prior}',
    ground='${ground}',
    self_training='${self_training}',
)
custom_hooks = [
    dict(type='EpochSeedHook'),
    dict(
        type='RegionMergeHook',
        interval='${sigma}',
        rounds='${label_refreshes}',
        warm_up_rounds='${warm_up_rounds}',
        dataloader='${label_dataloader}',
        label_maker='${label_maker}',
        labels_from='${labels_from}',
    ),
    '${method_hook}',
    dict(type='SafeCheckpointHook'),
    dict(type='RunRecordHook'),
    dict(type='ReportHook'),
]

# --- Schedule: eight rounds of 65 epochs, Adam (METHOD 7)
rounds = 8
sigma = 65  # epochs a round
warm_up_rounds = 1  # rounds that the first labels last
final_rounds = 1  # rounds that the last labels last
label_refreshes = None  # as many as the rounds allow; 1: the first labels stay
batch_size = 8
learning_rate = 1e-3
val_rounds = 2
train_cfg = dict(type='RoundTrainLoop', rounds='${rounds}', sigma='${sigma}', val_rounds='${val_rounds}')
val_cfg = dict(type='ValLoop')
test_cfg = dict(type='TestLoop')
optim_wrapper = dict(
    type='OptimWrapper',
    optimizer=dict(type='Adam', lr='${learning_rate}'),
    clip_grad=dict(max_norm=10.0),
    accumulative_counts='${accumulate}',
)
param_scheduler = '${one_cycle}'
one_cycle = [
    dict(
        type='OneCycleLR',
        eta_max='${learning_rate}',
        total_steps='${epochs}',
        pct_start=0.1,
        by_epoch=True,
        convert_to_iter_based=True,
    )
]
restart_schedule = [  # each period ends with a small step
    dict(
        type='CosineRestartLR',
        by_epoch=True,
        convert_to_iter_based=True,
        periods='${periods}',
        restart_weights='${restart_weights}',
        eta_min=5e-5,
    )
]
periods = ['${epochs}']  # epochs; their sum is that of training
restart_weights = [1]
step_schedule = [  # as the paper has it, for 8 x 65 epochs: / 5 after 60 epochs of a round, then from the start again
    dict(type='MultiStepLR', by_epoch=True, milestones=[60, 125, 190, 255, 320, 385, 450, 515], gamma=0.2),
    dict(type='MultiStepLR', by_epoch=True, milestones=[65, 130, 195, 260, 325, 390, 455], gamma=5.0),
]

# --- What --demo changes: data, sizes, epochs. The scenes are so few that all stay in memory.
demo = dict(
    data_root='data/${demo_data.scenes}',
    crop_points=24000,
    recent_scenes=64,
    voxel_size=0.3,
    widths=[16, 32, 48, 64, 80, 96],
    blocks=1,
    rounds=3,
    sigma=12,
    batch_size=1,
    learning_rate=1e-2,
    val_rounds=3,
    checkpoint_interval='${sigma}',
)
