# Semantic segmentation of a handful of SemanticKITTI scans, some of them without remission, on a CPU; a leaf adds a budget.
_base_ = [
    '../runtime.py',
    '../datasets/semantickitti.py',
    '../models/segmentor_tiles.py',
    '../regions/outdoor.py',
    '../schedules/tiles.py',
    '../schedules/demo_streets.py',
]
use_intensity = False
point_columns = ['shape']
train_sequences = [0]
val_sequences = [1, 99]
voxel_downsample = 0.1  # m; some scans come on a grid and others as they were measured: thinned, all are alike
# Few scans, so that others would look strange: crops are thinned, noised and scaled more than elsewhere.
train_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='HeightAboveGround'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='RandomDownsample', keep=[0.4, 1.0]),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.8, 1.2]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='PointNoise', jitter=0.02, columns=0.05),  # m; shape columns
    dict(type='AugmentedView', prob='${aug_prob}'),
    dict(type='PackScene'),
]
crop_points = 16000
class_power = 0.7
# So few scans teach a network that is best trusted little, and what regions may be no better than single examples do.
region_prior = dict(gamma=0.9, classifier='neighbors', distance_scale=None)
sigma = 80
periods = [80, 160]  # epochs, each one crop of each scan
checkpoint_interval = '${sigma}'
demo = dict(
    demo_data=dict(scenes='semantickitti_streets', num_train=60, num_val=12, seed=0),
    train_sequences=None,
    val_sequences=None,
)
