# KITTI object detection, native layout; only what the left camera sees. Lengths are for a 64-beam street scan.
_base_ = './detection.py'
dataset_type = 'KittiDataset'
data_root = 'data/kitti'
classes = ['Car', 'Pedestrian', 'Cyclist']
num_classes = 3  # as many as classes
point_range = [0.0, -40.0, -3.0, 70.4, 40.0, 1.0]  # m, lidar frame: x, y, z least, then greatest
heights = [-2.0, 1.0]  # m, lowest and highest usual z
class_sizes = [[3.9, 1.6, 1.56], [0.8, 0.6, 1.73], [1.76, 0.6, 1.73]]  # m, where no box of the class is annotated
near = [0.8, 0.4, 0.5]  # m to a centre, up to which a proposal means it
far = [1.6, 0.9, 1.1]  # m, from which it means none
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
    dict(type='LabelledObjectPaste', max_objects='${paste_objects}', accepted='${paste_accepted}'),
    dict(type='DropGround'),
    dict(type='RandomFlipY', prob=0.5),
    dict(type='GlobalRotScale', rot=[-0.785, 0.785], scale=[0.95, 1.05]),
    dict(type='AugmentedView', prob='${aug_prob}'),
    dict(type='PackScene'),
]
eval_pipeline = [dict(type='DropGround'), dict(type='PackScene')]
train_dataloader = dict(dataset=dict(ann_file='ImageSets/train.txt'))
label_dataloader = dict(dataset=dict(ann_file='ImageSets/train.txt'))
val_dataloader = dict(dataset=dict(ann_file='ImageSets/val.txt'))
val_evaluator = [
    dict(type='KittiMetric', classes='${classes}', metrics=['bev', '3d'], sampling='auto')  # official from 41 boxes on
]  # a list: mmengine reads the key `metrics` of a plain dict itself

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
# For groups of regions (teacher=None). The paper's gamma is .75 for all. Here unknown points count as background in
# part, so the network is taught that hidden objects are none, and no confidence means the same for every class and
# budget. So every group that is more likely an object than not becomes a candidate, its score asks the predicted
# boxes too, and the best share of each class, over all scenes, becomes pseudo boxes. The network alone never makes
# background.
objects = dict(
    gamma=0.4,
    class_gamma=[0.4, 0.4, 0.4, 1.1],  # as classes, then background
    support_iou=0.2,
    seen_height=[0.0, 0.7, 0.7],  # people are seen up to their heads
    seen_length=[0.0, 0.2, 0.2],
    top_fraction=[0.4, 0.45, 0.5, 0.5],
)

# --- What --demo changes: data, sizes, epochs
demo = dict(
    data_root='data/demo_streets',
    demo_data=dict(scenes='streets', num_train=70, num_val=30, seed=0),
    num_workers=1,  # scenes are read and pasted into beside the network
    oversegmenter=dict(max_edge=0.3, range_growth=0.015),  # m; the virtual lidar has half as many points a turn
    voxel_size=0.15,
    widths=[16, 32, 48, 64],
    blocks=1,
    num_seeds=512,
    num_proposals=128,
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
