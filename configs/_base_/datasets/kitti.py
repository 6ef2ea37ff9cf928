# KITTI object detection, native layout; only what the left camera sees.
_base_ = './loaders.py'
data_root = 'data/kitti'
classes = ['Car', 'Pedestrian', 'Cyclist']
point_range = [0.0, -40.0, -3.0, 70.4, 40.0, 1.0]  # m, lidar frame: x, y, z least, then greatest
paste_objects = 8  # labelled objects of other frames copied into each training frame

train_dataloader = dict(
    dataset=dict(
        type='KittiDataset',
        split='train',
        ann_file='ImageSets/train.txt',
        classes='${classes}',
        point_range='${point_range}',
        pipeline=[
            dict(type='LabelledObjectPaste', max_objects='${paste_objects}'),
            dict(type='DropGround'),
            dict(type='RandomFlipY', prob=0.5),
            dict(type='GlobalRotScale', rot=[-0.785, 0.785], scale=[0.95, 1.05]),
            dict(type='AugmentedView'),
            dict(type='PackScene'),
        ],
    ),
)
label_dataloader = dict(
    dataset=dict(
        type='KittiDataset',
        split='train',
        ann_file='ImageSets/train.txt',
        classes='${classes}',
        point_range='${point_range}',
        pipeline=[dict(type='DropGround'), dict(type='PackScene')],
    ),
)
val_dataloader = dict(
    dataset=dict(
        type='KittiDataset',
        split='val',
        ann_file='ImageSets/val.txt',
        classes='${classes}',
        point_range='${point_range}',
        pipeline=[dict(type='DropGround'), dict(type='PackScene')],
    ),
)
val_evaluator = [
    dict(type='KittiMetric', classes='${classes}', metrics=['bev', '3d'])
]  # a list: mmengine reads the key `metrics` of a plain dict itself
