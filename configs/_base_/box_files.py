# Your own scans with boxes (docs/own_boxes.md), z up, metres. What is None here is found in the data and told: classes and
# sizes from the annotated boxes, the range from the points, and every length from the sizes. No demo.
_base_ = './detection.py'
measured = 'boxes'
dataset_type = 'BoxFilesDataset'
data_root = 'data/scans'
box_format = 'auto'
columns = None  # which column plays which part, where names do not tell
intensity_range = None  # strength that reads as 1; None: each scan's own
unit = None  # m that count as one to all that follows, below too: 1 for objects between a chair and a lorry
train_list = None  # file with the name of a scan in each line; None: train.txt, ImageSets/train.txt or the folder train
val_list = None
classes = None
num_classes = None
class_sizes = None  # m
point_range = None  # m; stays None for scans far from zero
heights = None  # m
near = None  # m
far = None  # m
radius = None  # m
heading_bins = None  # 1 where no annotated box is turned, else 12
box_kind = None  # of pseudo boxes: axis_aligned likewise, else completed
voxel_size = None  # m
paste_objects = 8  # annotated objects of other scans copied into each training scan
paste_accepted = False  # True: pseudo objects of the round, too
train_pipeline = None  # the one or the other: whether any annotated box is turned
turning_pipeline = [
    dict(
        type='LabelledObjectPaste',
        max_objects='${paste_objects}',
        accepted='${paste_accepted}',
        places=dict(bearing=[-3.1416, 3.1416]),
    ),
    dict(type='DropGround'),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='GlobalRotScale', rot=[-0.785, 0.785], scale=[0.95, 1.05]),
    dict(type='AugmentedView', prob='${aug_prob}'),
    dict(type='PackScene'),
]
aligned_pipeline = [  # nothing is turned: boxes stand along the axes
    dict(type='DropGround'),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='GlobalRotScale', rot=[0.0, 0.0], scale=[0.9, 1.1]),
    dict(type='AugmentedView', prob='${aug_prob}'),
    dict(type='PackScene'),
]
eval_pipeline = [dict(type='DropGround'), dict(type='PackScene')]
reading = dict(
    box_format='${box_format}',
    columns='${columns}',
    intensity_range='${intensity_range}',
    unit='${unit}',
    cache='${cache_dir}',
)
train_dataloader = dict(dataset=dict(ann_file='${train_list}', **reading))
label_dataloader = dict(dataset=dict(ann_file='${train_list}', **reading))
val_dataloader = dict(dataset=dict(ann_file='${val_list}', **reading))
del reading
val_evaluator = [dict(type='IndoorDetMetric', classes='${classes}')]
model = dict(vote_head=dict(radius='${radius}', heading_bins='${heading_bins}'))

descriptor_radius = None  # m
heading_bins = None  # 1 where no annotated box is turned, else 12
box_kind = None  # of pseudo boxes: axis_aligned likewise, else completed
max_edge = None  # m at the sensor
max_gap = None  # m between adjacent regions
centre_distance = None  # m
class_gamma = None
descriptor = dict(type='AdaptedPFH', radius='${descriptor_radius}', range_growth=0.1, max_neighbors=48)
oversegmenter = dict(
    type='RegionGrowing',
    threshold=0.9,
    zeta=0.05,
    min_region=30,
    max_edge='${max_edge}',
    range_growth=0.01,  # m a metre of range
    ground=dict(),  # taken away before growing
)
merge = dict(rounds='${label_refreshes}', centre_distance='${centre_distance}')
objects = dict(
    gamma=0.4,
    box='${box_kind}',
    class_gamma='${class_gamma}',
    support_iou=0.2,
    top_fraction=[0.4, 0.45, 0.5, 0.5],
)

# The network of the demos and a schedule for some dozen to some hundred scans.
widths = [16, 32, 48, 64]
blocks = 1
num_seeds = 512
num_proposals = 128
hidden = 64
rounds = 10
sigma = 4  # epochs a round
warm_up_rounds = 6  # 24 epochs with the first labels
periods = [24, 4, 4, 4, 4]
restart_weights = [1, 1, 1, 1, 1]
batch_size = 4
learning_rate = 2e-3
val_rounds = 10
demo = None
