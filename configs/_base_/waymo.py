# Waymo Open Dataset, perception v2 (parquet; extra `waymo`): all around the car. Lengths as on KITTI's page.
_base_ = './detection.py'
dataset_type = 'WaymoDataset'
data_root = 'data/waymo'
every = 5  # each so-many-th frame of a segment: two a second
classes = ['Vehicle', 'Pedestrian', 'Cyclist']
num_classes = 3  # as many as classes
point_range = [-75.2, -75.2, -2.0, 75.2, 75.2, 4.0]  # m, vehicle frame: x, y, z least, then greatest
heights = [-0.3, 2.7]  # m, lowest and highest usual z
class_sizes = [[4.7, 2.1, 1.7], [0.9, 0.86, 1.73], [1.78, 0.84, 1.78]]  # m, where no box of the class is annotated
near = [0.8, 0.4, 0.5]  # m to a centre, up to which a proposal means it
far = [1.6, 0.9, 1.1]  # m, from which it means none
num_seeds = 2048
num_proposals = 512
tta_views = [[False, 0.0], [True, 0.0], [False, 0.35], [True, -0.35]]
on_ground = True
score_by_height = True
score_by_points = True
aug_prob = 0.25
teacher = '${predicted_boxes}'  # predicted boxes become pseudo boxes
# Objects stand apart, are as high as their boxes say, and look like annotated ones.
predicted_boxes = dict(top=0.95, seen_height=0.85, least_likeness=0.1)
cluster_descriptor = dict(type='Semantic')  # what they look like, beside their shapes
pseudo_geometry = 0.0  # pasted objects teach where a box lies
paste_objects = 8  # annotated objects of other frames copied into each training frame
paste_accepted = False  # True: pseudo objects of the round, too
train_pipeline = [
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
eval_pipeline = [dict(type='DropGround'), dict(type='PackScene')]
train_dataloader = dict(dataset=dict(every='${every}'))
label_dataloader = dict(dataset=dict(every='${every}'))
val_dataloader = dict(dataset=dict(every='${every}'))
val_evaluator = [dict(type='WaymoMetric', classes='${classes}')]

descriptor = dict(type='AdaptedPFH', radius=0.3, range_growth=0.1, max_neighbors=48)
oversegmenter = dict(
    type='RegionGrowing',
    threshold=0.9,
    zeta=0.05,
    min_region=30,
    max_edge=0.2,  # m at the sensor
    range_growth=0.01,  # m a metre of range
    ground=dict(),  # taken away before growing
)
max_gap = 0.6  # m between adjacent regions
merge = dict(rounds='${label_refreshes}', centre_distance=[1.2, 0.5, 0.7, None])  # as classes, then background
objects = dict(  # as on KITTI's page
    gamma=0.4,
    class_gamma=[0.4, 0.4, 0.4, 1.1],
    support_iou=0.2,
    seen_height=[0.0, 0.7, 0.7],
    seen_length=[0.0, 0.2, 0.2],
    top_fraction=[0.4, 0.45, 0.5, 0.5],
)

# --- What --demo changes: data, sizes, epochs
demo = dict(
    data_root='data/demo_waymo',
    demo_data=dict(scenes='waymo_streets', num_train=70, num_val=30, seed=0),
    num_workers=1,  # scenes are read and pasted into beside the network
    every=1,
    oversegmenter=dict(max_edge=0.3, range_growth=0.015),  # m; the virtual lidar has half as many points a turn
    voxel_size=0.15,
    widths=[16, 32, 48, 64],
    blocks=1,
    num_seeds=1024,
    num_proposals=256,
    hidden=64,
    rounds=14,
    sigma=4,
    warm_up_rounds=6,  # 24 epochs with the first labels
    periods=[56],
    restart_weights=[1],
    batch_size=2,
    learning_rate=2e-3,
    val_rounds=14,
)
