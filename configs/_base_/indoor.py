# Classes or instances of points in rooms, all but the data set: how scenes are read, augmented and cut into regions, the
# network, the labels, the schedule, and what --demo changes. A data set's page (scannet.py, s3dis.py) goes on from here.

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
crop_points = 250000
elastic_prob = 0.95
method_view = None  # of a compared method: a further view
aug_prob = 0.25  # share of scenes with a second view for L_Aug; 1, as the paper has it: a step costs half more
train_pipeline = [  # METHOD 7
    dict(type='RandomCrop', max_points='${crop_points}', shape='column'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.9, 1.1]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='ElasticDistortion', prob='${elastic_prob}'),
    dict(type='ColorAutoContrast'),
    dict(type='ColorJitter'),
    dict(type='AugmentedView', prob='${aug_prob}'),
    '${method_view}',
    dict(type='PackScene'),
]
eval_pipeline = [dict(type='PackScene')]
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

# --- Task
task = (
    'semantic'  # 'instances': offsets to their middles and masks are learnt, and clusters of shifted points predicted
)
tasks = dict(
    semantic=dict(head=None, offset_loss=None, dice_loss=None, metrics=[dict(type='SemSegMetric')], spread=False),
    instances=dict(
        head='${point_group}',
        offset_loss='${instance_offsets}',
        dice_loss='${instance_dice}',
        metrics=[dict(type='SemSegMetric'), dict(type='${instance_metric}')],
        spread=True,
    ),
)
val_evaluator = '${tasks.${task}.metrics}'
test_evaluator = '${val_evaluator}'

# --- Network: the paper's sparse U-Net, m = 16, seven levels, two blocks, 2 cm voxels. Wide: widths = [32, 64, ..., 224].
voxel_size = 0.02  # m
widths = [16, 32, 48, 64, 80, 96, 112]
blocks = 2
use_coordinates = False  # True: the place in the scene too; crops then differ from whole scenes
use_columns = '${point_columns}'  # []: a network that sees shapes only
tta_rotations = 1  # directions from which a scene is predicted
first_angle = (
    30.0  # degrees by which a scene is turned first; rooms stand along the axes, as turned rooms hardly ever do
)
superpoint_smoothing = (
    0.0  # share of its region's mean in a point's probabilities; above 0 eval_pipeline has RegionNumbers
)
logit_adjustment = 0.0  # of the classes' annotated labels, at test time; larger: rare classes are said more rarely
instance_head = '${tasks.${task}.head}'
cluster_radius = 0.03  # m
cluster_points = 50
min_proposal_points = 100
point_group = dict(
    type='PointGroupHead',
    proposals=dict(
        radius='${cluster_radius}',
        cluster_points='${cluster_points}',
        min_points='${min_proposal_points}',
        nms_iou=0.3,
        coordinates='both',
    ),
)
model = dict(
    type='RM3DSegmentor',
    num_classes='${num_classes}',
    inputs=dict(columns='${point_columns}', use='${use_columns}', coordinates='${use_coordinates}'),
    backbone=dict(type='SparseUNet', voxel_size='${voxel_size}', widths='${widths}', blocks='${blocks}'),
    semantic_head=dict(type='SemanticHead'),
    instance_head='${instance_head}',
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
losses = ['${point_loss}', '${aug_loss}', '${offset_loss}', '${dice_loss}', '${method_loss}']
class_balance = 'batch'  # by the labels of a batch; 'frequency': by the annotated labels; 'none'
class_power = 0.5  # weight of a class = labels of it ^ -0.5
pseudo_weight = 1.0  # of a label that the budget did not show
confidence_power = 0.0
annotated_share = None  # of L_WSL that annotated labels have, however few; None: all labels alike
offset_weight = 1.0  # of the offsets' loss; smaller: classes are learnt faster
dice_weight = 1.0  # of the masks' loss
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
offset_loss = '${tasks.${task}.offset_loss}'
dice_loss = '${tasks.${task}.dice_loss}'
instance_offsets = dict(type='InstanceOffsets', loss=dict(type='OffsetLoss', loss_weight='${offset_weight}'))
instance_dice = dict(type='InstanceDice', loss=dict(type='DiceLoss', loss_weight='${dice_weight}'))

# --- Labels: how points become regions and regions merge (METHOD 3, 5, 6), with lengths for 1 to 5 cm between points.
budget_seed = '${seed}'  # a leaf says `budget`: docs/label_budgets.md
descriptor = dict(type='AdaptedPFH', radius=0.1)
oversegmenter = dict(type='RegionGrowing', zeta=0.015, max_color_step=0.2)
region_seeds = 'none'  # 'annotated': regions grow from the annotated points first; then each budget has its own
graph_neighbors = 8
max_gap = 0.1  # m between adjacent regions
propagate = True  # False: training sees the annotated points alone
strategy = 'default'  # labels spread by a random walk; 'regions': regions merge; 'paper': by `merge` alone
walker = dict()  # walker.accept=.7, say, for fewer and purer labels
random_walk = dict()
merge = dict(rounds='${label_refreshes}', centre_distance=0.3)
propagation = dict(max_color=0.45, max_extent=3.0, new_instances=False)
region_prior = dict(gamma=0.6)  # of prior and network together
ground = None
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
    merge='${merge}',
    walker='${walker}',
    random_walk='${random_walk}',
    instances='${tasks.${task}.spread}',
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
param_scheduler = '${restart_schedule}'
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

# --- What --demo changes: data, sizes, epochs
demo = dict(
    data_root='data/${demo_data.scenes}',
    crop_points=30000,
    voxel_size=0.08,
    widths=[16, 32, 48, 64, 80, 96],
    blocks=1,
    cluster_radius=0.08,  # m; the virtual camera leaves a point each 4 cm
    cluster_points=20,
    min_proposal_points=40,
    rounds=4,
    sigma=5,
    batch_size=1,
    learning_rate=1e-2,
    val_rounds=5,
)
