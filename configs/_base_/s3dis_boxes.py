# S3DIS, native layout: axis-aligned boxes of the five classes of furniture that detectors are compared on (as in GSDN,
# ECCV 2020), around the instances; Area 5 is the test area by default. Lengths are for rooms.
_base_ = './detection.py'
dataset_type = 'InstanceBoxDataset'
scenes = 'S3DISDataset'
test_area = 5
scene_options = dict(test_area='${test_area}')
data_root = 'data/s3dis'
val_split = 'test'
classes = ['table', 'chair', 'sofa', 'bookcase', 'board']
num_classes = 5  # as many as classes
point_range = None
heights = [0.0, 2.5]  # m, lowest and highest usual z
class_sizes = [  # m, where no box of the class is annotated; ScanNet's, by name (a board is a picture there)
    [0.97, 0.97, 0.67], [0.61, 0.61, 0.76], [1.40, 1.40, 0.83], [0.89, 0.89, 1.21], [0.42, 0.42, 0.56],
]  # fmt: skip
near = 0.3  # m to a centre, up to which a proposal means it; METHOD 7
far = 0.6  # m, from which it means none
crop_points = 100000  # most points of a room in training
train_pipeline = [  # boxes stand along the axes, so rooms are not turned
    dict(type='LimitPoints', max_points='${crop_points}'),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='GlobalRotScale', rot=[0.0, 0.0], scale=[0.85, 1.15]),
    dict(type='AugmentedView', prob='${aug_prob}'),
    dict(type='PackScene'),
]
eval_pipeline = [dict(type='PackScene')]
reading = dict(scenes='${scenes}', scene_options='${scene_options}')
train_dataloader = dict(dataset=reading)
label_dataloader = dict(dataset=reading)
val_dataloader = dict(dataset=dict(split='${val_split}', **reading))
del reading
val_evaluator = [dict(type='IndoorDetMetric', classes='${classes}')]
voxel_size = 0.04  # m
model = dict(vote_head=dict(heading_bins=1, radius=0.3, samples=16))

descriptor = dict(type='AdaptedPFH', radius=0.1)
oversegmenter = dict(type='RegionGrowing', zeta=0.015, max_color_step=0.2)
max_gap = 0.1  # m between adjacent regions
merge = dict(rounds='${label_refreshes}', centre_distance=0.3)
objects = dict(
    gamma=0.4,
    box='axis_aligned',
    support_iou=0.2,
    class_gamma=[0.4, 0.4, 0.4, 0.4, 0.4, 1.1],
    top_fraction=[0.4, 0.45, 0.5, 0.5],
)

# --- What --demo changes: data, sizes, epochs
demo = dict(
    data_root='data/${demo_data.scenes}',
    demo_data=dict(scenes='s3dis_rooms', rooms_per_area=10, seed=0),
    crop_points=30000,
    voxel_size=0.08,
    widths=[16, 32, 48, 64],
    blocks=1,
    num_seeds=512,
    num_proposals=128,
    hidden=64,
    rounds=10,
    sigma=4,
    warm_up_rounds=6,  # 24 epochs with the first labels
    periods=[24, 4, 4, 4, 4],
    restart_weights=[1, 1, 1, 1, 1],
    batch_size=4,
    learning_rate=2e-3,
    val_rounds=10,
)
