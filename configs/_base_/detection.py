# Boxes, all but the data set: the network, its losses, the labels and the schedule. A data set's page (kitti.py) goes on from here.

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
train_dataloader = dict(
    batch_size='${batch_size}',
    num_workers='${num_workers}',
    persistent_workers=False,
    collate_fn=dict(type='pseudo_collate'),
    sampler=dict(type='EpochSampler', shuffle=True),
    dataset=dict(
        type='${dataset_type}',
        data_root='${data_root}',
        split='train',
        labels='store',
        label_store='${work_dir}/labels',
        classes='${classes}',
        point_range='${point_range}',
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
        split='train',
        labels='none',
        classes='${classes}',
        point_range='${point_range}',
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
        split='val',
        labels='truth',
        classes='${classes}',
        point_range='${point_range}',
        bad_scenes='${bad_scenes}',
        pipeline='${eval_pipeline}',
    ),
)
test_dataloader = '${val_dataloader}'
test_evaluator = '${val_evaluator}'

# --- Network: sparse VoteNet; sizes of the classes come from the annotated boxes at the start of a run
voxel_size = 0.1  # m
widths = [32, 64, 96, 128]
blocks = 2
num_seeds = 1024
num_proposals = 256
hidden = 128
unlabelled_weight = 0.1  # how far unknown points count as background; a few per cent of them are objects
model = dict(
    type='RM3DVoteNet',
    num_classes='${num_classes}',
    heights='${heights}',
    backbone=dict(type='SparseUNet', voxel_size='${voxel_size}', widths='${widths}', blocks='${blocks}'),
    vote_head=dict(
        type='VoteHead',
        mean_sizes='${class_sizes}',
        heading_bins=12,
        num_seeds='${num_seeds}',
        num_proposals='${num_proposals}',
        hidden='${hidden}',
        radius=1.2,
        samples=32,
        near='${near}',
        far='${far}',
        unlabelled_weight='${unlabelled_weight}',
    ),
    iou_head='${iou_head}',
    losses='${losses}',
    fuse_iou=0.3,
    score_by_points='${score_by_points}',
    on_ground='${on_ground}',
    score_by_height='${score_by_height}',
    tta_views='${tta_views}',
)
on_ground = False  # predicted boxes stand on the ground; streets have it on
score_by_height = False  # with on_ground: scores ask how far up the points of a box reach; streets have it on
score_by_points = False  # scores of boxes also ask the classes of their points; streets have it on
tta_views = [[False, 0.0], [True, 0.0]]  # at test time: mirrored, turned by so many radians; None: as scanned alone

iou_head = None  # '${box_iou_head}', with iou_loss='${box_overlap}': scores are multiplied by how well a box fits
box_iou_head = dict(type='BoxIoUHead')

# --- Losses (METHOD 7). One that is None is left out, and one of your own is a further entry.
losses = [
    '${vote_loss}',
    '${point_loss}',
    '${aug_loss}',
    '${dice_loss}',
    '${scene_class_loss}',
    '${iou_loss}',
    '${prototype_loss}',
    '${method_loss}',
]
method_loss = None  # of a compared method
method_hook = None  # of a compared method: a teacher, say, or pre-trained weights
labels_from = 'network'  # whose predictions make labels; 'teacher': its running mean (method_hook='${mean_teacher}')
mean_teacher = dict(type='EMATeacherHook', momentum=0.99)
aug_prob = 1.0  # share of scenes with a second view for L_Aug; smaller, as streets have it: faster
pseudo_geometry = 1.0  # how far pseudo boxes teach where a box lies; 0: annotated ones alone do
vote_loss = dict(type='VoteNetLoss', loss_weight=10.0, pseudo_geometry='${pseudo_geometry}')
point_loss = dict(
    type='WeakSupervision',
    balance='batch',
    power=0.25,
    loss=dict(type='PointCrossEntropyLoss', loss_weight=10.0, unlabelled_weight='${unlabelled_weight}'),
)
aug_loss = dict(type='ViewConsistency', loss=dict(type='JSAugLoss'))
dice_loss = dict(type='ProposalDice', loss=dict(type='DiceLoss'))
scene_class_loss = dict(type='SceneClasses', num_classes='${num_classes}')
iou_loss = None
box_overlap = dict(type='BoxOverlap')
prototype_loss = None  # '${class_prototypes}': several prototypes a class, for the classes of points alone
class_prototypes = dict(type='ClassPrototypes', num_classes='${num_classes}', channels='${widths[0]}')

# --- Labels: how points become regions, regions merge and groups become boxes (METHOD 3, 5, 6)
budget_seed = '${seed}'  # a leaf says `budget`: docs/label_budgets.md
graph_neighbors = 8
strategy = 'default'  # 'paper': `merge` alone, as METHOD 6 has it, and axis-aligned boxes
teacher = None  # '${predicted_boxes}': predicted boxes become pseudo boxes, in place of groups of regions by `objects`
# Objects may hang or stand on others here; streets ask how far up they reach, and what they look like.
predicted_boxes = dict(share=0.7)
cluster_descriptor = None  # what clusters above the ground look like, beside their shapes; streets have `Semantic`
self_training = dict()  # self_training.cbst_fraction=.2, say; its defaults limit and check nothing
label_maker = dict(
    type='DetectionLabelMaker',
    store='${work_dir}/labels',
    cache='${cache_dir}',
    source=dict(
        type='BoxBudgetSource', dataset='${label_dataloader.dataset}', budget='${budget}', seed='${budget_seed}'
    ),
    descriptor='${descriptor}',
    oversegmenter='${oversegmenter}',
    graph_neighbors='${graph_neighbors}',
    max_gap='${max_gap}',
    strategy='${strategy}',
    merge='${merge}',
    objects='${objects}',
    self_training='${self_training}',
    teacher='${teacher}',
    cluster_descriptor='${cluster_descriptor}',
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

# --- Schedule: eight rounds of 40 epochs, Adam
rounds = 8
sigma = 40  # epochs a round
warm_up_rounds = 1  # rounds that the first labels last
final_rounds = 1  # rounds that the last labels last
label_refreshes = None  # as many as the rounds allow; 1: the first labels stay
batch_size = 16
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
restart_schedule = [  # a period ends with a small step; the demo of streets has one, and makes labels within it
    dict(
        type='CosineRestartLR',
        by_epoch=True,
        convert_to_iter_based=True,
        periods='${periods}',
        restart_weights='${restart_weights}',
        eta_min=5e-5,
    )
]
periods = [40, 40, 40, 40, 40, 40, 40, 40]  # epochs, one for each set of labels; their sum is that of training
restart_weights = [1, 1, 1, 1, 1, 1, 1, 1]
milestones = [80, 160]  # epochs
step_schedule = [dict(type='MultiStepLR', by_epoch=True, milestones='${milestones}', gamma=0.1)]  # as the paper has it
