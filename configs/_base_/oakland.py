# Oakland 3-D, native text tiles: 6 classes, neither colour nor intensity; a handful of tiles and a CPU. No demo.
_base_ = './outdoor.py'
dataset_type = 'OaklandDataset'
data_root = 'data/oakland'
val_split = 'test'
num_classes = 6
thing_classes = []
point_columns = ['shape', 'clearance']
train_tiles = None  # None: those of the split
val_tiles = None
train_dataloader = dict(dataset=dict(tiles='${train_tiles}', cache='${cache_dir}'))
label_dataloader = dict(dataset=dict(tiles='${train_tiles}', cache='${cache_dir}'))
val_dataloader = dict(dataset=dict(tiles='${val_tiles}', cache='${cache_dir}'))
# The columns are noised, and a step sees a small crop of every tile: one large crop is no sample of them, and the whole tiles
# of the test then look strange to the batch normalisation.
crop_points = 4000
aug_prob = 0.0  # 1: a step costs two thirds more
train_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='HeightAboveGround'),
    dict(type='ClearanceFeatures'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.9, 1.1]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='PointNoise', jitter=0.0, columns=0.05),
    dict(type='AugmentedView', prob='${aug_prob}'),
    '${method_view}',
    dict(type='PackScene'),
]
# At test time tiles are read from eight sides, the points of a region speak together, and rare classes are rare.
eval_pipeline = [
    dict(
        type='RegionNumbers',
        cache='${cache_dir}',
        descriptor='${descriptor}',
        oversegmenter='${oversegmenter}',
        graph_neighbors='${graph_neighbors}',
        max_gap='${max_gap}',
    ),
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='HeightAboveGround'),
    dict(type='ClearanceFeatures'),
    dict(type='PackScene'),
]
tta_rotations = 8
superpoint_smoothing = 0.5
logit_adjustment = 0.2
voxel_size = 0.3  # m
widths = [16, 32, 48, 64, 80]
blocks = 1
class_power = 0.8
annotated_share = None
# The ground is one class, and a network that sees rare classes more often than they are needs a higher confidence.
zeta = 0.02
propagation = None
region_prior = dict(classifier='neighbors', gamma=0.75, inverse_temperature=2.0)
ground = None
# Two refreshes of the labels; that in the middle of the second period does not disturb it. An epoch is one step.
rounds = 3
sigma = 160
param_scheduler = '${restart_schedule}'
periods = [160, 320]
restart_weights = [1, 0.8]
batch_size = 6
learning_rate = 4e-3
val_rounds = 3
checkpoint_interval = '${sigma}'
demo = None
