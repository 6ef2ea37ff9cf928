# A handful of SemanticKITTI scans, some of them without remission, on a CPU.
_base_ = './outdoor.py'
dataset_type = 'SemanticKittiDataset'
data_root = 'data/semantickitti'
num_classes = 19
thing_classes = [0, 1, 2, 3, 4, 5, 6, 7]
point_columns = ['shape']
use_intensity = False
train_sequences = [0]
val_sequences = [1, 99]
voxel_downsample = 0.1  # m; some scans come on a grid and others as they were measured: downsampled, all are alike
train_dataloader = dict(dataset=dict(sequences='${train_sequences}', use_intensity='${use_intensity}'))
label_dataloader = dict(dataset=dict(sequences='${train_sequences}', use_intensity='${use_intensity}'))
val_dataloader = dict(dataset=dict(sequences='${val_sequences}', use_intensity='${use_intensity}'))
# Few scans, so that others would look strange: crops are thinned, noised and scaled more than elsewhere.
crop_points = 16000
aug_prob = 0.0  # 1: a step costs two thirds more
train_pipeline = [
    dict(type='ShapeFeatures', cache='${cache_dir}'),
    dict(type='HeightAboveGround'),
    dict(type='ClassCrop', max_points='${crop_points}'),
    dict(type='RandomDownsample', keep=[0.4, 1.0]),
    dict(type='GlobalRotScale', rot=[-3.1416, 3.1416], scale=[0.8, 1.2]),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='PointNoise', jitter=0.02, columns=0.05),  # m; shape columns
    dict(type='AugmentedView', prob='${aug_prob}'),
    '${method_view}',
    dict(type='PackScene'),
]
voxel_size = 0.3  # m
widths = [16, 32, 48, 64, 80]
blocks = 1
class_power = 0.7
annotated_share = None
# So few scans teach a network that is best trusted little, and what regions may be no better than single examples do.
ground_cell = 1.5  # m
zeta = 0.02
propagation = None
region_prior = dict(classifier='neighbors', gamma=0.9, distance_scale=None)
ground = None
# Two refreshes of the labels; that in the middle of the second period does not disturb it. An epoch is a crop of each scan.
rounds = 3
sigma = 80
param_scheduler = '${restart_schedule}'
periods = [80, 160]
restart_weights = [1, 0.8]
batch_size = 1
learning_rate = 4e-3
val_rounds = 3
checkpoint_interval = '${sigma}'
demo = dict(
    demo_data=dict(scenes='semantickitti_streets', num_train=60, num_val=12, seed=0),
    train_sequences=None,
    val_sequences=None,
    periods=[12, 24],
    learning_rate=4e-3,
)
